"""One core of a cluster: a pool of one worker process on some machine, fed from afar. Knows nothing of Ray.

All that goes in and out is JSON (floats come back bit for bit) and the bytes of traces: a cluster needs no shared
folder for results, and nothing of ours is pickled on the way.
"""

from __future__ import annotations

import json
import os
import platform
import sys
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tsbench.core.errors import InputError
from tsbench.episode.trace import trace_path
from tsbench.run.contract import contract_hash
from tsbench.run.execution.base import Limits
from tsbench.run.execution.local import Pool
from tsbench.run.execution.task_queue import Task, TaskQueue
from tsbench.run.execution.worker_process import Setup
from tsbench.run.log.record import Record
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog

_DATA = "TSBENCH_DATA"


class RayActor:
    """Answers `probe`, `configure`, `run` and `close`, one at a time, in the main thread of its process."""

    def __init__(self, hello: str) -> None:
        """hello: JSON of what `handshake` says on the machine that the run was started on."""
        told = json.loads(hello)
        if Path(told["cwd"]).is_dir():
            # Planners are named by paths that start where the command was given.
            os.chdir(told["cwd"])
        sys.path += [place for place in told["sys_path"] if place not in sys.path]
        if told["data"]:
            os.environ.setdefault(_DATA, told["data"])
        self._folder = TemporaryDirectory(prefix="tsbench-seat-")
        self._setup: Setup | None = None
        self._pool = Pool(1, Limits(**told["limits"]))
        self._pool.__enter__()

    def probe(self, specs: str) -> str:
        """JSON: what the planners of a JSON list are, or the problem with one."""
        try:
            return json.dumps({"planners": self._pool.probe(json.loads(specs))})
        except InputError as problem:
            return json.dumps({"problem": str(problem)})

    def configure(self, setup: str) -> str:
        """Take a run's setup (JSON); returns "" or, in one line, why this machine cannot take part."""
        told = json.loads(setup)
        self._setup = replace(Setup(**told), out=self._folder.name)
        here = platform.node()
        try:
            contract = contract_hash(read_table(table_path(told["split"])), load_catalog())
            if contract != told["contract"]:
                return (
                    f"node {here}: its contract is {contract[:12]}, the run's is {told['contract'][:12]}: "
                    "install the same tsbench and data there"
                )
            found = self._pool.probe([planner["spec"] for planner in told["planners"]])
        except InputError as problem:
            return f"node {here}: {problem}"
        for ours, theirs in zip(found, told["planners"], strict=True):
            if ours != theirs:
                return f"node {here}: planner {theirs['spec']} is another one there (its code or weights)"
        return ""

    def run(self, task: str) -> tuple[str, bytes]:
        """One episode: its record as JSON, or the problem that ends the run, and its trace, b"" for none."""
        assert self._setup is not None
        told = json.loads(task)
        spec = ScenarioSpec(**told["spec"])
        records: list[Record] = []
        try:
            work = TaskQueue([Task(told["number"], told["planner"], spec)])
            self._pool.run(self._setup, work, records.append, lambda: False)
        except InputError as problem:
            return json.dumps({"problem": f"node {platform.node()}: {problem}"}), b""
        (record,) = records
        path = trace_path(Path(self._folder.name), record.row["planner"], spec.scenario_id)
        trace = path.read_bytes() if record.trace_sha256 is not None else b""
        path.unlink(missing_ok=True)
        return json.dumps(asdict(record)), trace

    def close(self) -> None:
        """End the worker."""
        self._pool.__exit__(None)
        self._folder.cleanup()


def handshake(limits: Limits) -> str:
    """What a seat is told of the machine that the run was started on."""
    return json.dumps(
        {
            "cwd": str(Path.cwd()),
            "sys_path": sys.path,
            "data": os.environ.get(_DATA),
            "limits": asdict(limits),
        }
    )
