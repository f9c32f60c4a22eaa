"""The worker process: takes episodes from its parent, sends records back. Started by `worker_process` only.

python -m tsbench.run.execution.worker_main CONNECTION_FD HEARTBEAT_FD REAPER_PID
"""

from __future__ import annotations

import hashlib
import importlib
import os
import socket
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from tsbench.core.errors import InputError, cause_in_planner, cause_of
from tsbench.core.machine import die_with
from tsbench.episode.outcome import EpisodeResult, Outcome, Phase
from tsbench.episode.trace import trace_path, write_trace
from tsbench.planners.registry import resolve
from tsbench.run import opened_files
from tsbench.run.execution import messages
from tsbench.run.execution.fresh_episode import end_as, run_in_child
from tsbench.run.execution.messages import Heartbeat, Task
from tsbench.run.log.record import Record, cut_short, error_row, last_seconds, lost_timing, make_timing
from tsbench.run.planner_info import PlannerInfo, describe, place_of, resolve_unchanged
from tsbench.scenarios.spec import ScenarioSpec


class Runner(Protocol):
    """What this module asks of an episode runner."""

    def prepare(self, spec: ScenarioSpec) -> None:
        """Make what episodes begin with; raises whatever the planner does."""

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        """One episode; what a scene or planner does wrong is an outcome, no exception."""

    def close(self) -> None:
        """End the simulation."""


class Worker:
    """One simulation at a time: the runner of the planner used last."""

    def __init__(self, connection: socket.socket, heartbeat: Heartbeat) -> None:
        self._connection, self._heartbeat = connection, heartbeat
        self._lines = connection.makefile("rb")
        self._setup: messages.Setup
        self._pid = os.getpid()
        self._current = -1
        self._runner: Runner | None = None
        self._watched: dict[int, bool] = {}
        self._place: Path | None = None

    def serve(self) -> None:
        """Answer messages until the parent closes the connection."""
        start = messages.decode(self._lines.readline(), (messages.Start,))
        sys.path[:] = start.sys_path
        self._say(messages.Ready(self._pid))
        for line in self._lines:
            message: Any = messages.decode(line, messages.TO_WORKER)
            if isinstance(message, messages.Setup):
                self._setup = message
                self._watched.clear()
            else:
                self._answer(message)

    def _answer(self, message: Task | messages.Probe) -> None:
        if isinstance(message, messages.Probe):
            self._say(self._probe(message))
        elif self._begins_afresh(message.planner):
            self._prepare(message)
            status = run_in_child(lambda: self._play(message))
            if status is not None:
                end_as(status)
        else:
            self._play(message)

    def _play(self, task: Task) -> None:
        """One episode, with its answer to the parent; in a child of this process, or here."""
        self._pid = os.getpid()
        self._say(self._episode(task))

    def _begins_afresh(self, planner: int) -> bool:
        """Are episodes of a planner to begin as if there had been no other?

        Those of the package's own do so by themselves (tests/planners/test_memory.py). Isolated ones are elsewhere.
        """
        return self._is_watched(planner) and not self._setup.planners[planner].may_remember

    def _is_watched(self, planner: int) -> bool:
        """Is what a planner opens and leaves in episodes to be noted? It runs here, and is not of the package."""
        if planner not in self._watched:
            self._watched[planner] = not (self._setup.loader or _own(self._setup.planners[planner]))
        return self._watched[planner]

    def _prepare(self, task: Task) -> None:
        """Make the planner and load the roads, for a child to begin with. What fails fails in the child once more."""
        self._heartbeat.begin(task.number)
        # Whatever it is, the planner raised it.
        with suppress(BaseException):
            runner = self._runner_of(task.planner)
            self._heartbeat.beat(Phase.PLANNING)
            runner.prepare(task.spec)
        self._exit_if_forked()

    def close(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None

    def _say(self, message: Any) -> None:
        self._connection.sendall(messages.encode(message))

    def _exit_if_forked(self) -> None:
        """Is this the child of a planner that has forked? It has no business with our parent."""
        if os.getpid() != self._pid:
            os._exit(0)

    def _probe(self, asked: messages.Probe) -> messages.Probed:
        self._heartbeat.beat(Phase.PLANNING)
        try:
            return messages.Probed(describe(asked.spec, asked.device))
        except InputError as problem:
            return messages.Probed(None, str(problem))
        finally:
            self._exit_if_forked()
            self._heartbeat.beat(Phase.IDLE)

    def _episode(self, task: Task) -> messages.Finished | messages.FolderFailed:
        self._heartbeat.begin(task.number)
        if self._is_watched(task.planner):
            with opened_files.noted(self._heartbeat.leave) as seen:
                record, result = self._run(task)
            self._exit_if_forked()
            record = replace(record, opened=self._names(seen, task.planner), left=seen.left)
        else:
            record, result = self._run(task)
            self._exit_if_forked()
        if result is not None and self._wants_trace(record, result):
            path = trace_path(Path(self._setup.out), result.planner, task.spec.scenario_id)
            try:
                write_trace(path, result)
                record = replace(record, trace_sha256=hashlib.sha256(path.read_bytes()).hexdigest())
            except OSError as problem:
                # No matter of this episode: the folder takes nothing more, the whole run has to stop.
                return messages.FolderFailed(problem.errno or 0, problem.strerror or "", str(problem.filename or path))
        self._heartbeat.beat(Phase.IDLE)
        return messages.Finished(task.number, record)

    def _names(self, seen: opened_files.Opened, planner: int) -> tuple[str, ...]:
        """Of the files that a planner read in an episode those that the run does not know it by yet."""
        known = opened_files.names(self._setup.planners[planner].opened)
        return tuple(sorted({*opened_files.of_planner(seen.files, self._place, seen.foreign)}.difference(known)))

    def _run(self, task: Task) -> tuple[Record, EpisodeResult | None]:
        spec, who = task.spec, self._setup.planners[task.planner]
        try:
            result = self._runner_of(task.planner).run(spec)
        except BaseException as problem:
            # Nobody asks a worker to end by an exception: whatever it is, KeyboardInterrupt too, the planner raised it.
            row = error_row(spec, who.name, who.privileged, Outcome.PLANNER_ERROR, cause_in_planner(problem))
            return Record(row, [], lost_timing(spec, who.name, 0.0), cut_short(traceback.format_exc())), None
        self._heartbeat.beat(Phase.SCORING)
        try:
            record: Record = _named(self._setup.recorder)(result, who.privileged)
        except Exception as problem:
            # A defect in a metric is an error outcome with its traceback, never a figure.
            error = f"internal error: {cause_of(problem)}"
            row = error_row(spec, who.name, who.privileged, Outcome.SIM_ERROR, error)
            record = Record(row, [], make_timing(result), traceback.format_exc())
        if record.detail:
            ending = last_seconds(result) or "  (it ended before the first tick)"
            story = f"{cut_short(record.detail).rstrip()}\n\nLast seconds\n{ending}\n"
            record = replace(record, events=[], detail=story)
        return record, result

    def _wants_trace(self, record: Record, result: EpisodeResult) -> bool:
        if result.facts is None or not result.facts.snapshots or self._setup.trace == "none":
            return False
        return self._setup.trace == "all" or bool(record.events) or not record.row["scd"]

    def _runner_of(self, planner: int) -> Runner:
        """The runner of a planner. Making one is the planner's time: it is the planner that is loaded."""
        if self._runner is None or planner != self._current:
            self.close()
            self._heartbeat.beat(Phase.PLANNING)
            self._runner = self._make_runner(self._setup.planners[planner])
            self._current = planner
            self._heartbeat.begin(self._heartbeat.task)
        return self._runner

    def _make_runner(self, who: PlannerInfo) -> Runner:
        setup = self._setup
        loaded = _named(setup.loader)(who, setup.hidden) if setup.loader else resolve_unchanged(who)
        self._place = place_of(loaded)
        runner: Runner = _named(setup.runner)(
            loaded.on(setup.device),
            perception=setup.perception,
            heartbeat=self._heartbeat.beat,
            data=setup.data,
            **setup.options,
        )
        return runner


def _own(who: PlannerInfo) -> bool:
    """Is a planner part of this package? No for one that cannot be loaded."""
    try:
        return resolve(who.spec).own
    except InputError:
        return False


def _named(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    made: Callable[..., Any] = getattr(importlib.import_module(module), attribute)
    return made


def main(arguments: list[str]) -> None:
    connection_fd, heartbeat_fd, parent = (int(argument) for argument in arguments)
    die_with(parent)
    for fd in (connection_fd, heartbeat_fd):
        # A child that a planner starts shall not hold the parent's line open.
        os.set_inheritable(fd, False)
    worker = Worker(socket.socket(fileno=connection_fd), Heartbeat(heartbeat_fd))
    worker.serve()
    worker.close()


if __name__ == "__main__":
    main(sys.argv[1:])
