"""The executor of a Ray cluster: many actors of one core, each with a worker process of its own.

The same hand-out, worker and record as on one machine, so the same bytes. A node that dies takes its actors along:
what they had not answered is given out again, and new actors wait for room on the cluster.
"""

from __future__ import annotations

import logging
import os
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.machine import MemoryUse
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import trace_path
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
from tsbench.run.execution.ray_actor import RayActor, handshake
from tsbench.run.log.record import Record, error_row, lost_timing
from tsbench.run.planner_info import PlannerInfo

_TICK_S = 0.25
_SHUTDOWN_TIMEOUT_S = 5.0
_REACH_TIMEOUT_S = 10.0
# A cluster that grows by itself takes minutes to bring up a machine.
_PATIENCE_S = 900.0
_TRIES = 3
# Most episodes in one task of Ray's, which costs the driver as much as one episode would; and into how many tasks for
# each actor the rest is cut at least, so that all end at about the same time.
_MOST_TOGETHER, _SHARES = 20, 4


@dataclass
class _ActorHandle:
    """An actor as its driver sees it. asked: the answer that its configuration waits for; held: tasks sent, oldest
    first, those of one answer together with it; planner: of the last. ready: it takes tasks.
    """

    actor: Any
    asked: Any = None
    planner: int | None = None
    held: deque[tuple[Any, list[Task]]] = field(default_factory=deque)
    ready: bool = False

    def busy(self) -> bool:
        return self.asked is not None or bool(self.held)

    def next_answer(self) -> Any:
        """The answer that comes next: an actor does one thing after the other."""
        return self.held[0][0] if self.asked is None else self.asked


class RayExecutor:
    """Actors on the cluster that RAY_ADDRESS names, or on the one that this machine belongs to."""

    def __init__(self, workers: int | None, most: int, limits: Limits) -> None:
        """workers: actors, None = one for each CPU of the cluster; never more than `most`."""
        self._wanted, self._most, self._limits = workers, most, limits
        self._actors: list[_ActorHandle] = []
        self._setup: Setup | None = None
        self._deaths: dict[int, int] = {}
        self._suspects: set[int] = set()
        self._failed_starts = 0
        self._stack = ExitStack()

    def __enter__(self) -> RayExecutor:
        """Connect, and ask for all actors."""
        address = os.environ.get("RAY_ADDRESS", "auto")
        # What Ray says of its nodes by itself belongs beside the progress, not into our output.
        self._stack.enter_context(redirect_stdout(sys.stderr))
        try:
            _check_reachable(address)
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
        except (OSError, ValueError, RuntimeError, RayError) as problem:
            self._stack.close()
            raise InputError(
                f"--executor ray: no cluster at {address!r} ({' '.join(str(problem).split())[:200]}); "
                "start one (ray start --head) or set RAY_ADDRESS"
            ) from None
        self._stack.callback(ray.shutdown)
        count = self._wanted or int(ray.cluster_resources().get("CPU", 0))
        if not count:
            self._stack.close()
            raise InputError(f"--executor ray: the cluster at {address!r} has no CPU to work with")
        self._remote = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(RayActor)
        self._actors = [self._start() for _ in range(min(count, self._most))]
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """End all actors: idle ones kindly, so that nothing of a planner is left, the others at once."""
        if kind is None:
            partings = [handle.actor.close.remote() for handle in self._actors if handle.ready and not handle.held]
            if partings:
                ray.wait(partings, num_returns=len(partings), timeout=_SHUTDOWN_TIMEOUT_S)
        for handle in self._actors:
            ray.kill(handle.actor)
        self._actors = []
        self._stack.close()

    def memory(self) -> list[MemoryUse]:
        """None: the workers are elsewhere."""
        return []

    def probe(self, specs: Sequence[str], device: str = "cpu") -> list[PlannerInfo]:
        """What each planner is, asked at the actor that is up first."""
        if device != "cpu":
            raise InputError(f"--device {device}: actors of the ray executor have CPUs only")
        lines = [encode(Probe(spec)) for spec in specs]
        asked = {handle.actor.probe.remote(lines): handle for handle in self._actors}
        end = time.monotonic() + _PATIENCE_S
        why = "no node has room"
        while asked and time.monotonic() < end:
            for answer in self._wait(list(asked)):
                handle = asked.pop(answer)
                try:
                    told = [decode(line, (Probed,)) for line in ray.get(answer)]
                except RayError as problem:
                    why = _line(problem)
                    continue
                handle.ready = False
                for probed in told:
                    if probed.problem:
                        raise InputError(probed.problem)
                return [probed.planner for probed in told if probed.planner is not None]
        raise InputError(f"--executor ray: nobody on the cluster takes work: {why}")

    def run(self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]) -> None:
        self._setup = setup
        for handle in self._actors:
            self._configure(handle, setup)
        seen = time.monotonic()
        while not stop():
            self._fill(tasks)
            if not tasks.left and not any(handle.held for handle in self._actors):
                return
            waiting = {handle.next_answer(): slot for slot, handle in enumerate(self._actors) if handle.busy()}
            for answer in self._wait(list(waiting)):
                self._take(waiting[answer], answer, tasks, keep)
            if any(handle.ready for handle in self._actors):
                seen = time.monotonic()
            elif time.monotonic() - seen > _PATIENCE_S:
                raise InputError(
                    f"--executor ray: no node has taken work for {_PATIENCE_S:g} s; finished episodes are kept"
                )

    def _start(self) -> _ActorHandle:
        handle = _ActorHandle(self._remote.remote(handshake(self._limits)))
        if self._setup is not None:
            self._configure(handle, self._setup)
        return handle

    def _configure(self, handle: _ActorHandle, setup: Setup) -> None:
        handle.asked = handle.actor.configure.remote(encode(setup))

    def _wait(self, answers: list[Any]) -> list[Any]:
        """Those that have come, all at once, after a moment at most."""
        first, _ = ray.wait(answers, num_returns=1, timeout=_TICK_S)
        return ray.wait(answers, num_returns=len(answers), timeout=0)[0] if first else []

    def _fill(self, tasks: TaskQueue) -> None:
        """Give work to actors that have little. Some waits ahead, so that no actor waits for the network."""
        ahead = 2 if tasks.left > len(self._actors) else 1
        for slot, handle in enumerate(self._actors):
            while handle.ready and len(handle.held) < ahead:
                found = self._next(slot, handle, tasks)
                if not found:
                    return
                # A task that may have taken an actor along runs alone.
                alone = [[task] for task in found if task.number in self._suspects]
                together = [task for task in found if task.number not in self._suspects]
                for group in [*alone, together] if together else alone:
                    answer = handle.actor.run.remote([encode(task) for task in group])
                    handle.held.append((answer, group))

    def _next(self, slot: int, handle: _ActorHandle, tasks: TaskQueue) -> list[Task]:
        """The next episodes of an actor, of one planner, and on one network as far as that has so many."""
        most = min(tasks.left // (_SHARES * len(self._actors)), _MOST_TOGETHER)
        # An actor changes its worker with the planner: it keeps to one while that has tasks.
        task = tasks.next(slot, handle.planner) or tasks.next(slot)
        found: list[Task] = []
        while task is not None:
            handle.planner = task.planner
            found.append(task)
            task = tasks.next(slot, handle.planner) if len(found) < most else None
        return found

    def _take(self, slot: int, answer: Any, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """One answer of an actor: it is configured, has run episodes, or is no more."""
        handle = self._actors[slot]
        try:
            told = ray.get(answer)
        except RayError as problem:
            self._handle_death(slot, _line(problem), tasks, keep)
            return
        if handle.asked is not None:
            if told:
                raise InputError(decode(told, (Refused,)).problem)
            handle.asked, handle.ready = None, True
            return
        for line, trace in told:
            message: Any = decode(line, (Finished, Refused))
            if isinstance(message, Refused):
                raise InputError(message.problem)
            self._write_trace(message.record, trace)
            keep(message.record)
        handle.held.popleft()
        self._failed_starts = 0

    def _write_trace(self, record: Record, content: bytes) -> None:
        assert self._setup is not None
        if record.trace_sha256 is None:
            return
        path = trace_path(Path(self._setup.out), record.row["planner"], record.row["scenario_id"])
        with io_errors_as_input_errors(path):
            write_atomic(path, content)

    def _handle_death(self, slot: int, why: str, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """An actor is no more: another takes its place, its tasks are given out again."""
        handle = self._actors[slot]
        ray.kill(handle.actor)
        self._failed_starts += 1
        if self._failed_starts > _TRIES * len(self._actors):
            raise InputError(f"--executor ray: workers do not stay up: {why}; finished episodes are kept")
        self._actors[slot] = self._start()
        for number, (_, group) in enumerate(handle.held):
            if number == 0 and len(group) > 1:
                # One of them was being driven: whose fault it was is seen when each is on its own.
                self._suspects |= {task.number for task in group}
            for task in group:
                blamed = number == 0 and len(group) == 1
                self._deaths[task.number] = self._deaths.get(task.number, 0) + blamed
                if self._deaths[task.number] < _TRIES:
                    tasks.requeue(task)
                else:
                    keep(self._lost(task, why))

    def _lost(self, task: Task, why: str) -> Record:
        """An episode that took so many actors along is the cause, not the cluster."""
        assert self._setup is not None
        who = self._setup.planners[task.planner]
        error = f"its worker on the cluster ended {_TRIES} times"
        row = error_row(task.spec, who.name, who.privileged, Outcome.SIM_ERROR, error)
        return Record(row, [], lost_timing(task.spec, who.name, 0.0), f"{error}\n\n{why}\n")


def _check_reachable(address: str) -> None:
    """Is the cluster there? Ray itself would ask for minutes. Raises OSError or ValueError."""
    if address != "auto":
        host, _, port = address.rpartition("/")[2].rpartition(":")
        socket.create_connection((host, int(port)), timeout=_REACH_TIMEOUT_S).close()


def _line(problem: BaseException) -> str:
    return " ".join(str(problem).split())[:300]
