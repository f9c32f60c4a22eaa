"""The pool of workers: hands out episodes, notices who died or hangs; no episode costs another one."""

from __future__ import annotations

import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError, load
from tsbench.core.files import io_errors_as_input_errors
from tsbench.core.machine import MemoryUse, cause_of_end, own_cores, resident_mb
from tsbench.run.execution.messages import Executor, FolderFailed, Limits, Probed, Ready, Setup, Task, TaskQueue
from tsbench.run.execution.own_folder import remove_abandoned
from tsbench.run.execution.worker_process import Overrun, WorkerProcess, find_overrun, lost_record
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo

_TICK_S = 0.25
_SHUTDOWN_TIMEOUT_S = 2.0
_MOST_FAILED_STARTS = 3
# Signals that come from outside (a person, the kernel short of memory): the episode gets a second worker.
_FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM)


class Pool:
    """The executor of this machine: worker processes."""

    def __init__(self, count: int, limits: Limits | None = None) -> None:
        self._limits = limits or Limits()
        self._memory: list[MemoryUse] = []
        self._workers: list[WorkerProcess | None] = [None] * count
        self._selector = selectors.DefaultSelector()
        self._setup: Setup | None = None
        self._failed_starts = 0
        self._looked = 0.0
        # Planners with an episode that left something outside its process, and did not end.
        self._leavers: set[str] = set()

    def __enter__(self) -> Pool:
        """Start all: they come up while the parent has other things to do."""
        for slot in range(len(self._workers)):
            self._start(slot)
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """End all workers: kindly if all went well, at once if not."""
        workers = [worker for worker in self._workers if worker is not None]
        if kind is None:
            idle = [worker for worker in workers if worker.ready and not worker.held]
            for worker in idle:
                worker.shutdown()
            end = time.monotonic() + _SHUTDOWN_TIMEOUT_S
            for worker in idle:
                with suppress(subprocess.TimeoutExpired):
                    worker.process.wait(max(end - time.monotonic(), 0.0))
        for worker in workers:
            worker.end()
        self._workers = [None] * len(self._workers)
        self._selector.close()
        # Those that were killed could not remove their folders.
        remove_abandoned()

    def probe(self, specs: Sequence[str], device: str = "cpu") -> list[PlannerInfo]:
        """What each planner is, asked in a worker that has met no other: making one may change or end a process."""
        found: list[PlannerInfo] = []
        count = len(self._workers)
        # The first ones last: theirs are then there for the run's first episodes.
        for first in reversed(range(0, len(specs), count)):
            some = specs[first : first + count]
            for slot, spec in enumerate(some):
                self._untouched(slot, spec).send_probe(spec, device)
            found[:0] = [self._await_probe(slot, spec) for slot, spec in enumerate(some)]
        return found

    def run(self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]) -> None:
        self._setup = setup
        for slot, worker in enumerate(self._workers):
            if worker is not None and self._index_of(worker.planner) not in (None, tasks.planner):
                # It was asked about a planner whose turn has not come.
                self._drop(slot, worker)
            elif worker is not None:
                worker.configure(setup)
        while not stop():
            self._fill(tasks)
            idle = not tasks.left and not any(worker and worker.held for worker in self._workers)
            if idle and not tasks.requeue_alone():
                return
            for slot in self._poll(keep):
                self._handle_death(slot, tasks, keep)
            self._watch(tasks, keep)
        for slot, worker in enumerate(self._workers):
            if worker is not None and worker.held:
                # It would go on, and write its trace behind our back.
                self._drop(slot, worker)

    def memory(self) -> list[MemoryUse]:
        return [use for use in self._memory if use.episodes]

    def _fill(self, tasks: TaskQueue) -> None:
        """Give work to workers that have little. One episode waits ahead, so that no worker waits for us."""
        for slot in range(len(self._workers)):
            if not tasks.left:
                return
            worker = self._workers[slot]
            if worker is not None and worker.outgrown and not worker.held:
                self._drop(slot, worker)
            worker = self._workers[slot] or self._start(slot)
            while self._takes_more(worker, tasks.left):
                task = tasks.next(slot, self._index_of(worker.planner))
                if task is None:
                    if not worker.held:
                        # Its planner has no more episodes, and it shall meet no other.
                        self._drop(slot, worker)
                        self._start(slot)
                    break
                if not worker.held:
                    worker.changed, worker.spent = time.monotonic(), None
                worker.planner = self._planner_of(task).spec
                worker.send_task(task)

    def _planner_of(self, task: Task) -> PlannerInfo:
        assert self._setup is not None
        return self._setup.planners[task.planner]

    def _index_of(self, spec: str) -> int | None:
        """Number of a planner; None without a spec."""
        assert self._setup is not None
        return [p.spec for p in self._setup.planners].index(spec) if spec else None

    def _untouched(self, slot: int, spec: str) -> WorkerProcess:
        """A worker that has met no planner but this."""
        worker = self._workers[slot]
        if worker is not None and worker.planner not in ("", spec):
            self._drop(slot, worker)
            worker = None
        return worker or self._start(slot)

    def _takes_more(self, worker: WorkerProcess, left: int) -> bool:
        wanted = 2 if left > len(self._workers) else 1
        return worker.ready and not worker.outgrown and len(worker.held) < wanted

    def _start(self, slot: int) -> WorkerProcess:
        with io_errors_as_input_errors(Path("starting a worker process")):
            worker = WorkerProcess(time.monotonic(), self._limits.most_memory)
        self._memory.append(worker.memory)
        if self._setup is not None:
            worker.configure(self._setup)
        self._workers[slot] = worker
        self._selector.register(worker.connection, selectors.EVENT_READ, (slot, "message"))
        self._selector.register(worker.log_fd, selectors.EVENT_READ, (slot, "log"))
        self._selector.register(worker.death_fd, selectors.EVENT_READ, (slot, "death"))
        return worker

    def _poll(self, keep: Callable[[Record], None]) -> Iterator[int]:
        """Take in what comes within a moment; gives the slots of workers from which nothing more will come."""
        for key, _ in self._selector.select(_TICK_S):
            slot, event = key.data
            worker = self._workers[slot]
            if worker is None:
                # It was dropped by an event of the same round.
                continue
            if event == "log":
                if not worker.read_log():
                    self._forget(worker.log_fd)
                continue
            self._receive(worker, keep)
            worker.closed = worker.closed or event == "death"
            if worker.closed_at is not None:
                # Its end follows, or it is given up.
                self._forget(worker.connection)
            if worker.closed:
                yield slot

    def _receive(self, worker: WorkerProcess, keep: Callable[[Record], None]) -> None:
        for message in worker.receive():
            if isinstance(message, Ready):
                worker.ready, worker.pid = True, message.pid
                worker.changed, worker.spent = time.monotonic(), None
            elif isinstance(message, Probed):
                worker.answer = message
            elif isinstance(message, FolderFailed):
                with io_errors_as_input_errors(Path()):
                    raise OSError(message.errno, message.reason, message.filename)
            elif not worker.held or worker.held[0].number != message.task:
                # Not what it was asked for: nothing that it says can be trusted.
                worker.closed = True
                return
            else:
                worker.held.popleft()
                self._failed_starts = 0
                use, limits = worker.memory, self._limits
                use.take(resident_mb(worker.pid))
                worker.outgrown = use.last > limits.memory and use.episodes >= limits.least_episodes
                keep(self._marked(_with_output(message.record, worker), worker))
                worker.drop_tail()

    def _marked(self, record: Record, worker: WorkerProcess) -> Record:
        """A record that says of a planner what an episode before could not."""
        unsaid = worker.planner in self._leavers and not record.left
        return replace(record, left=("an episode that did not end",)) if unsaid else record

    def _watch(self, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """End workers that have shown no sign of life for too long, or take too much memory."""
        now = time.monotonic()
        if now - self._looked < _TICK_S:
            return
        self._looked = now
        for slot, worker in enumerate(self._workers):
            if worker is not None:
                worker.give_up(now)
                if worker.closed:
                    self._handle_death(slot, tasks, keep)
                    continue
            if worker is None or (worker.ready and not worker.held):
                continue
            overrun = find_overrun(worker, self._limits, now)
            if overrun is not None:
                held = len(worker.held)
                self._receive(worker, keep)
                # Its answer may have come in this very moment.
                if len(worker.held) == held:
                    self._handle_death(slot, tasks, keep, overrun)

    def _handle_death(
        self, slot: int, tasks: TaskQueue, keep: Callable[[Record], None], overrun: Overrun | None = None
    ) -> None:
        """A worker is at its end: settle what it was doing, give back what it had not begun."""
        worker = self._workers[slot]
        assert worker is not None
        status = self._drop(slot, worker)
        if worker.heartbeat.left:
            self._leavers.add(worker.planner)
        begun = worker.heartbeat.task in [task.number for task in worker.held]
        self._failed_starts = 0 if begun else self._failed_starts + 1
        if begun:
            task = worker.held.popleft()
            # A planner that took too long beside others may be in time alone.
            late = overrun is not None and overrun.late
            outside = overrun is None and not worker.broken and status in _FROM_OUTSIDE
            if not ((late or outside) and tasks.retry(task, alone=late)):
                keep(self._marked(lost_record(worker, task, self._planner_of(task), status, overrun), worker))
        for task in worker.held:
            tasks.requeue(task)
        if self._failed_starts >= _MOST_FAILED_STARTS:
            said = worker.tail_text().splitlines() or ["it said nothing"]
            raise InputError(f"worker processes do not start ({cause_of_end(status)}): {said[-1]}")

    def _await_probe(self, probed: int, spec: str) -> PlannerInfo:
        worker = self._workers[probed]
        assert worker is not None
        overrun = None
        while worker.answer is None and not worker.closed and overrun is None:
            for slot in self._poll(_no_record):
                other = self._workers[slot]
                if other is not None and not other.planner:
                    self._drop(slot, other)
            worker.give_up(time.monotonic())
            overrun = find_overrun(worker, self._limits, time.monotonic())
        if worker.answer is not None:
            answer, worker.answer = worker.answer, None
            if answer.planner is None:
                raise InputError(answer.problem)
            return answer.planner
        status = self._drop(probed, worker)
        if overrun is not None:
            raise InputError(f"--planner {spec}: importing and making it: {overrun.text}")
        said = worker.tail_text().splitlines() or ["it said nothing"]
        raise InputError(
            f"--planner {spec}: importing or making it ended the process ({cause_of_end(status)}): {said[-1]}"
        )

    def _drop(self, slot: int, worker: WorkerProcess) -> int:
        """End a worker and leave its slot empty; returns its exit status."""
        for file in (worker.connection, worker.log_fd, worker.death_fd):
            self._forget(file)
        self._workers[slot] = None
        return worker.end()

    def _forget(self, file: Any) -> None:
        if file in self._selector.get_map():
            self._selector.unregister(file)


def _no_record(record: Record) -> None:
    raise AssertionError(f"a record before the first task: {record.row}")


def _with_output(record: Record, worker: WorkerProcess) -> Record:
    """A record as it came; where there was an error, with what the worker printed."""
    if not record.detail:
        return record
    worker.read_log()
    output = worker.tail_text() or "  (none)"
    return replace(record, detail=f"{record.detail.rstrip()}\n\nOutput of the worker\n{output}\n")


EXECUTORS = ("local", "ray")


def make_executor(kind: str, workers: int | None, most: int, limits: Limits) -> Executor:
    """An executor, one of EXECUTORS. workers: how many, None = one for each core; never more than `most`.

    Raises InputError where Ray is asked for and not installed, or its cluster cannot be reached.
    """
    if kind == "ray":
        executor: Executor = load("tsbench.run.execution.ray").RayExecutor(workers, most, limits)
        return executor
    return Pool(min(workers or own_cores(), most), limits)
