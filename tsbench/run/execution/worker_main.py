"""The worker process: takes episodes from its parent, sends records back. Started by `process.py` only.

python -m tsbench.run.execution.worker_main CONNECTION_FD PULSE_FD WARDEN_PID
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import json
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from tsbench.core.errors import InputError, cause_of
from tsbench.episode.outcome import Outcome
from tsbench.episode.result import EpisodeResult
from tsbench.episode.trace import trace_path, write_trace
from tsbench.run.execution.heartbeat import IDLE, PLANNING, SCORING, Heartbeat
from tsbench.run.log.record import Record, cut_short, error_row, last_seconds, lost_timing, make_timing
from tsbench.run.planner_info import describe
from tsbench.scenarios.spec import ScenarioSpec

Message = dict[str, Any]

_PR_SET_PDEATHSIG = 1


class Runner(Protocol):
    """What this module asks of an episode runner."""

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        """One episode; what a scene or planner does wrong is an outcome, no exception."""

    def close(self) -> None:
        """End the simulation."""


class Worker:
    """One simulation at a time: the runner of the planner used last. `_setup`: see `process.Setup`."""

    def __init__(self, connection: socket.socket, heartbeat: Heartbeat) -> None:
        self._connection, self._heartbeat = connection, heartbeat
        self._told = connection.makefile("rb")
        self._setup: Message = {}
        self._pid = os.getpid()
        self._current = -1
        self._runner: Runner | None = None

    def serve(self) -> None:
        """Answer messages until the parent closes the connection."""
        sys.path[:] = json.loads(self._told.readline())["sys_path"]
        self._say({"ready": self._pid})
        for line in self._told:
            message = json.loads(line)
            if message["do"] == "setup":
                self._setup = message["setup"]
            else:
                self._say(
                    self._episode(message) if message["do"] == "episode" else self._probe(message["spec"])
                )

    def close(self) -> None:
        """End the simulation that is on."""
        if self._runner is not None:
            self._runner.close()
            self._runner = None

    def _say(self, message: Message) -> None:
        self._connection.sendall(json.dumps(message).encode() + b"\n")

    def _leave_if_forked(self) -> None:
        """Is this the child of a planner that has forked? It has no business with our parent."""
        if os.getpid() != self._pid:
            os._exit(0)

    def _probe(self, spec: str) -> Message:
        """What a planner is, or in one line why there is none."""
        self._heartbeat.beat(PLANNING)
        try:
            return {"planner": describe(spec)}
        except InputError as problem:
            return {"problem": str(problem)}
        finally:
            self._leave_if_forked()
            self._heartbeat.beat(IDLE)

    def _episode(self, message: Message) -> Message:
        spec = ScenarioSpec(**message["spec"])
        self._heartbeat.begin(message["task"])
        record, result = self._run(spec, message["planner"])
        self._leave_if_forked()
        answer: Message = {"task": message["task"], "detail": record.detail, "trace": None}
        answer.update(row=record.row, events=record.events, timing=record.timing)
        if result is not None and self._wants_trace(record, result):
            path = trace_path(Path(self._setup["out"]), result.planner, spec.scenario_id)
            try:
                write_trace(path, result)
                answer["trace"] = hashlib.sha256(path.read_bytes()).hexdigest()
            except OSError as problem:
                # No matter of this episode: the folder takes nothing more, the whole run has to stop.
                answer["fatal"] = [problem.errno, problem.strerror, problem.filename]
        self._heartbeat.beat(IDLE)
        return answer

    def _run(self, spec: ScenarioSpec, planner: int) -> tuple[Record, EpisodeResult | None]:
        who = self._setup["planners"][planner]
        name, privileged = who["name"], who["privileged"]
        try:
            runner = self._take_runner(planner)
            result = runner.run(spec)
        except BaseException as problem:
            # Nobody asks a worker to end by an exception: whatever it is, KeyboardInterrupt too, the planner raised it.
            row = error_row(spec, name, privileged, Outcome.PLANNER_ERROR, cause_of(problem))
            return Record(row, [], lost_timing(spec, name, 0.0), cut_short(traceback.format_exc())), None
        self._heartbeat.beat(SCORING)
        try:
            record = _load(self._setup["recorder"])(result, privileged)
        except Exception as problem:
            # A defect in a metric is an error outcome with its traceback, never a figure.
            row = error_row(spec, name, privileged, Outcome.SIM_ERROR, f"internal error: {cause_of(problem)}")
            record = Record(row, [], make_timing(result), traceback.format_exc())
        if record.detail:
            ending = last_seconds(result) or "  (it ended before the first tick)"
            story = f"{cut_short(record.detail).rstrip()}\n\nLast seconds\n{ending}\n"
            record = Record(record.row, [], record.timing, story)
        return record, result

    def _wants_trace(self, record: Record, result: EpisodeResult) -> bool:
        if result.facts is None or not result.facts.snapshots or self._setup["trace"] == "none":
            return False
        return self._setup["trace"] == "all" or bool(record.events) or not record.row["scd"]

    def _take_runner(self, planner: int) -> Runner:
        """The runner of a planner. Making one is the planner's time: it is the planner that is loaded."""
        if self._runner is None or planner != self._current:
            self.close()
            who = self._setup["planners"][planner]
            self._heartbeat.beat(PLANNING)
            more = dict(self._setup["options"])
            if self._setup["inference"] and self._setup["device"] in who["served_on"]:
                more["inference"] = self._setup["inference"]
            self._runner = _load(self._setup["runner"])(
                who["spec"],
                who["name"],
                mask_signs=self._setup["mask_signs"],
                device=self._setup["device"],
                heartbeat=self._heartbeat.beat,
                **more,
            )
            self._current = planner
            self._heartbeat.begin(self._heartbeat.task)
        return self._runner


def _load(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    made: Callable[..., Any] = getattr(importlib.import_module(module), attribute)
    return made


def die_with(parent: int) -> None:
    """Ask the kernel to kill this process when `parent` ends; at once if it already has."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


def main(arguments: list[str]) -> None:
    """Connect to the parent and serve it."""
    connection_fd, pulse_fd, parent = (int(argument) for argument in arguments)
    die_with(parent)
    for fd in (connection_fd, pulse_fd):
        # A child that a planner starts shall not hold the parent's line open.
        os.set_inheritable(fd, False)
    worker = Worker(socket.socket(fileno=connection_fd), Heartbeat(pulse_fd))
    worker.serve()
    worker.close()


if __name__ == "__main__":
    main(sys.argv[1:])
