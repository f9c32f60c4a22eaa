"""The executor of a Ray cluster: a seat (an actor of one core) with a worker process of its own, many times.

The same hand-out, worker and record as on one machine, so the same bytes. A node that dies takes its seats along:
what they had not answered is given out again, and new seats wait for room on the cluster.
"""

from __future__ import annotations

import json
import logging
import os
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, redirect_stdout
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import trace_path
from tsbench.run.execution.base import Limits
from tsbench.run.execution.memory import MemoryUse
from tsbench.run.execution.ray_actor import RayActor, handshake
from tsbench.run.execution.task_queue import Task, TaskQueue
from tsbench.run.execution.worker_process import Setup
from tsbench.run.log.record import Record, error_row, lost_timing

_TICK_S = 0.25
_SHUTDOWN_TIMEOUT_S = 5.0
_REACH_TIMEOUT_S = 10.0
# A cluster that grows by itself takes minutes to bring up a machine.
_PATIENCE_S = 900.0
_TRIES = 3


@dataclass
class _ActorHandle:
    """A seat as its driver sees it. asked: the answer that its configuration waits for; held: tasks sent, oldest
    first, each with the answer that it waits for; planner: of the last. ready: it takes tasks.
    """

    actor: Any
    asked: Any = None
    planner: int | None = None
    held: deque[tuple[Any, Task]] = field(default_factory=deque)
    ready: bool = False

    def busy(self) -> bool:
        """Does it owe an answer?"""
        return self.asked is not None or bool(self.held)

    def next_answer(self) -> Any:
        """The answer that comes next: a seat does one thing after the other."""
        return self.held[0][0] if self.asked is None else self.asked


class RayExecutor:
    """Seats on the cluster that RAY_ADDRESS names, or on the one that this machine belongs to."""

    def __init__(self, workers: int | None, most: int, limits: Limits) -> None:
        """workers: seats, None = one for each CPU of the cluster; never more than `most`."""
        self._wanted, self._most, self._limits = workers, most, limits
        self._places: list[_ActorHandle] = []
        self._setup: Setup | None = None
        self._deaths: dict[int, int] = {}
        self._failed_starts = 0
        self._stack = ExitStack()

    def __enter__(self) -> RayExecutor:
        """Connect, and ask for all seats."""
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
        seats = self._wanted or int(ray.cluster_resources().get("CPU", 0))
        if not seats:
            self._stack.close()
            raise InputError(f"--executor ray: the cluster at {address!r} has no CPU to work with")
        self._seat = ray.remote(num_cpus=1, max_restarts=0, scheduling_strategy="SPREAD")(RayActor)
        self._places = [self._start() for _ in range(min(seats, self._most))]
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """End all seats: idle ones kindly, so that nothing of a planner is left, the others at once."""
        if kind is None:
            partings = [
                place.actor.close.remote() for place in self._places if place.ready and not place.held
            ]
            if partings:
                ray.wait(partings, num_returns=len(partings), timeout=_SHUTDOWN_TIMEOUT_S)
        for place in self._places:
            ray.kill(place.actor)
        self._places = []
        self._stack.close()

    def memory(self) -> list[MemoryUse]:
        """None: the workers are elsewhere."""
        return []

    def probe(self, specs: Sequence[str]) -> list[dict[str, Any]]:
        """What each planner is, asked at the seat that is up first."""
        asked = {place.actor.probe.remote(json.dumps(specs)): place for place in self._places}
        end = time.monotonic() + _PATIENCE_S
        why = "no node has room"
        while asked and time.monotonic() < end:
            for answer in self._wait(list(asked)):
                place = asked.pop(answer)
                try:
                    told = json.loads(ray.get(answer))
                except RayError as problem:
                    why = _line(problem)
                    continue
                if "problem" in told:
                    raise InputError(told["problem"])
                place.ready = False
                planners: list[dict[str, Any]] = told["planners"]
                return planners
        raise InputError(f"--executor ray: nobody on the cluster takes work: {why}")

    def run(
        self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]
    ) -> None:
        """Run all tasks: see `Executor`."""
        if setup.device != "cpu":
            raise InputError(f"--device {setup.device}: seats of the ray executor have CPUs only")
        self._setup = setup
        for place in self._places:
            self._configure(place, setup)
        seen = time.monotonic()
        while not stop():
            self._fill(tasks)
            if not tasks.left and not any(place.held for place in self._places):
                return
            waiting = {place.next_answer(): slot for slot, place in enumerate(self._places) if place.busy()}
            for answer in self._wait(list(waiting)):
                self._take(waiting[answer], answer, tasks, keep)
            if any(place.ready for place in self._places):
                seen = time.monotonic()
            elif time.monotonic() - seen > _PATIENCE_S:
                raise InputError(
                    f"--executor ray: no node has taken work for {_PATIENCE_S:g} s; finished episodes are kept"
                )

    def _start(self) -> _ActorHandle:
        place = _ActorHandle(self._seat.remote(handshake(self._limits)))
        if self._setup is not None:
            self._configure(place, self._setup)
        return place

    def _configure(self, place: _ActorHandle, setup: Setup) -> None:
        place.asked = place.actor.configure.remote(json.dumps(asdict(setup)))

    def _wait(self, answers: list[Any]) -> list[Any]:
        """Those that have come, all at once, after a moment at most."""
        first, _ = ray.wait(answers, num_returns=1, timeout=_TICK_S)
        return ray.wait(answers, num_returns=len(answers), timeout=0)[0] if first else []

    def _fill(self, tasks: TaskQueue) -> None:
        """Give work to whoever has little. One episode waits ahead, so that no seat waits for the network."""
        ahead = 2 if tasks.left > len(self._places) else 1
        for slot, place in enumerate(self._places):
            while place.ready and len(place.held) < ahead:
                # A seat changes its worker with the planner: it keeps to one while that has tasks.
                task = tasks.next(slot, place.planner) or tasks.next(slot)
                if task is None:
                    return
                place.planner = task.planner
                told = {"number": task.number, "planner": task.planner, "spec": asdict(task.spec)}
                place.held.append((place.actor.run.remote(json.dumps(told)), task))

    def _take(self, slot: int, answer: Any, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """One answer of a seat: it is configured, has run an episode, or is no more."""
        place = self._places[slot]
        try:
            told = ray.get(answer)
        except RayError as problem:
            self._handle_death(slot, _line(problem), tasks, keep)
            return
        if place.asked is not None:
            if told:
                raise InputError(told)
            place.asked, place.ready = None, True
            return
        content, trace = json.loads(told[0]), told[1]
        if "problem" in content:
            raise InputError(content["problem"])
        place.held.popleft()
        self._failed_starts = 0
        record = Record(**content)
        self._write_trace(record, trace)
        keep(record)

    def _write_trace(self, record: Record, content: bytes) -> None:
        assert self._setup is not None
        if record.trace_sha256 is None:
            return
        path = trace_path(Path(self._setup.out), record.row["planner"], record.row["scenario_id"])
        with io_errors_as_input_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, content)

    def _handle_death(self, slot: int, why: str, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """A seat is no more: another takes its place, its tasks are given out again."""
        place = self._places[slot]
        ray.kill(place.actor)
        self._failed_starts += 1
        if self._failed_starts > _TRIES * len(self._places):
            raise InputError(f"--executor ray: workers do not stay up: {why}; finished episodes are kept")
        self._places[slot] = self._start()
        for number, (_, task) in enumerate(place.held):
            self._deaths[task.number] = self._deaths.get(task.number, 0) + (number == 0)
            if self._deaths[task.number] < _TRIES:
                tasks.requeue(task)
            else:
                keep(self._lost(task, why))

    def _lost(self, task: Task, why: str) -> Record:
        """An episode that took so many seats along is the cause, not the cluster."""
        assert self._setup is not None
        who: Mapping[str, Any] = self._setup.planners[task.planner]
        error = f"its worker on the cluster ended {_TRIES} times"
        row = error_row(task.spec, who["name"], who["privileged"], Outcome.SIM_ERROR, error)
        return Record(row, [], lost_timing(task.spec, who["name"], 0.0), f"{error}\n\n{why}\n")


def _check_reachable(address: str) -> None:
    """Is somebody there? Ray itself would ask for minutes. Raises OSError or ValueError."""
    if address != "auto":
        host, _, port = address.rpartition("/")[2].rpartition(":")
        socket.create_connection((host, int(port)), timeout=_REACH_TIMEOUT_S).close()


def _line(problem: BaseException) -> str:
    return " ".join(str(problem).split())[:300]
