"""One core of a cluster: a pool of one worker process on some machine, fed from afar. Knows nothing of Ray.

All that goes in and out is lines of `messages` and the bytes of traces: a cluster needs no shared folder for results,
and nothing of ours is pickled on the way.
"""

from __future__ import annotations

import os
import platform
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.episode.trace import trace_path
from tsbench.run.edition import code_hash, contract_now, standing_contract
from tsbench.run.execution.local import Pool
from tsbench.run.execution.messages import (
    Finished,
    Limits,
    Probe,
    Probed,
    Refused,
    Setup,
    Task,
    TaskQueue,
    decode,
    encode,
)
from tsbench.run.execution.own_folder import ACTOR, OwnFolder
from tsbench.run.log.record import Record

_DATA = "TSBENCH_DATA"


@dataclass(frozen=True)
class Handshake:
    """What an actor is told of the machine that the run was started on.

    code: hash of its tsbench (`contract.code_hash`).
    data: its folder of data, "" = tsbench's.
    """

    code: str
    cwd: str
    sys_path: tuple[str, ...]
    data: str
    limits: Limits


class RayActor:
    """Answers `probe`, `configure`, `run` and `close`, one at a time, in the main thread of its process."""

    def __init__(self, handshake: bytes) -> None:
        told = decode(handshake, (Handshake,))
        if Path(told.cwd).is_dir():
            # Planners are named by paths that start where the command was given.
            os.chdir(told.cwd)
        sys.path += [place for place in told.sys_path if place not in sys.path]
        if told.data:
            os.environ.setdefault(_DATA, told.data)
        self._code = told.code
        self._folder = OwnFolder(ACTOR)
        self._setup: Setup
        self._pool = Pool(1, told.limits)
        self._pool.__enter__()

    def probe(self, asked: list[bytes]) -> list[bytes]:
        """`Probed` to each `Probe`."""
        try:
            found = self._pool.probe([decode(line, (Probe,)).spec for line in asked])
        except InputError as problem:
            return [encode(Probed(None, str(problem)))]
        return [encode(Probed(planner)) for planner in found]

    def configure(self, setup: bytes) -> bytes:
        """Take a run's `Setup`; returns b"" or `Refused`: why this machine cannot take part."""
        told = decode(setup, (Setup,))
        self._setup = replace(told, out=str(self._folder.path))
        if self._code != code_hash():
            return _refused(
                f"its tsbench is {code_hash()[:12]}, the run's {self._code[:12]}: install the same tsbench there"
            )
        try:
            contract = standing_contract(contract_now(told.data, told.split))
            if contract != told.contract:
                return _refused(
                    f"its contract is {contract[:12]}, the run's is {told.contract[:12]}: "
                    "install the same tsbench and data there"
                )
            found = self._pool.probe([planner.spec for planner in told.planners])
        except InputError as problem:
            return _refused(str(problem))
        for ours, theirs in zip(found, told.planners, strict=True):
            if ours != theirs:
                return _refused(f"planner {theirs.spec} is another one there (its code or weights)")
        return b""

    def run(self, lines: list[bytes]) -> list[tuple[bytes, bytes]]:
        """`Task`s, one after the other: of each what `_run` says, up to the first `Refused`."""
        told: list[tuple[bytes, bytes]] = []
        for line in lines:
            task = decode(line, (Task,))
            answer, trace, goes_on = self._run(task)
            told.append((answer, trace))
            if not goes_on:
                break
        return told

    def _run(self, task: Task) -> tuple[bytes, bytes, bool]:
        """`Finished`, or `Refused` with what ends the run; its trace, b"" for none; does the run go on?"""
        records: list[Record] = []
        try:
            self._pool.run(self._setup, TaskQueue([task]), records.append, lambda: False)
        except InputError as problem:
            return _refused(str(problem)), b"", False
        (record,) = records
        path = trace_path(self._folder.path, record.row["planner"], task.spec.scenario_id)
        trace = path.read_bytes() if record.trace_sha256 is not None else b""
        path.unlink(missing_ok=True)
        return encode(Finished(task.number, record)), trace, True

    def close(self) -> None:
        self._pool.__exit__(None)
        self._folder.remove()


def _refused(problem: str) -> bytes:
    return encode(Refused(f"node {platform.node()}: {problem}"))


def handshake(limits: Limits) -> bytes:
    """What an actor is told by the machine that the run is started on."""
    return encode(Handshake(code_hash(), str(Path.cwd()), tuple(sys.path), os.environ.get(_DATA, ""), limits))
