"""The pool of workers: hands out episodes, notices who died or hangs; no episode costs another one."""

from __future__ import annotations

import selectors
import signal
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors
from tsbench.run.execution.base import Limits
from tsbench.run.execution.memory import MemoryUse, resident_mb
from tsbench.run.execution.task_queue import Task, TaskQueue
from tsbench.run.execution.watchdog import Overrun, find_overrun, lost_record
from tsbench.run.execution.worker_process import Message, Setup, WorkerProcess, cause_of_end
from tsbench.run.log.record import Record

if TYPE_CHECKING:
    from tsbench.run.execution.inference_client import InferenceServer

_TICK_S = 0.25
_SHUTDOWN_TIMEOUT_S = 2.0
_STILLBORN = 3
# Signals that come from outside (a person, the kernel short of memory): the episode gets a second worker.
_FROM_OUTSIDE = (-signal.SIGKILL, -signal.SIGTERM)


class Pool:
    """The executor of this machine: worker processes."""

    def __init__(self, count: int, limits: Limits | None = None, crowd: int | None = None) -> None:
        """crowd: how many workers, where they wait for an inference process more than they work; None = `count`."""
        self._limits = limits or Limits()
        self._crowd = crowd or count
        self._server: InferenceServer | None = None
        self._memory: list[MemoryUse] = []
        self._workers: list[WorkerProcess | None] = [None] * count
        self._selector = selectors.DefaultSelector()
        self._setup: Setup | None = None
        self._failed_starts = 0
        self._tried_twice: set[int] = set()
        # Episodes that took too long beside others: each is run once more at the end, alone.
        self._alone: deque[Task] = deque()
        self._tried_alone: set[int] = set()
        self._looked = 0.0

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
                self._forget(worker.connection)
                worker.shutdown()
            self._wait_for_ends(idle)
        for worker in workers:
            worker.end()
        self._workers = [None] * len(self._workers)
        self._selector.close()
        if self._server is not None:
            self._server.close()

    def probe(self, specs: Sequence[str]) -> list[dict[str, Any]]:
        """What each planner is, asked in a worker that has met no other: making one may change or end a process."""
        found: list[dict[str, Any]] = []
        count = len(self._workers)
        for first in range(0, len(specs), count):
            some = specs[first : first + count]
            for slot, spec in enumerate(some):
                self._unspoilt(slot, spec).send_probe(spec)
            found += [self._await_probe(slot, spec) for slot, spec in enumerate(some)]
        return found

    def run(
        self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]
    ) -> None:
        """Run all tasks: see `Executor`."""
        setup = self._setup = self._served(setup)
        for slot, worker in enumerate(self._workers):
            if worker is not None and self._index_of(worker.planner) not in (None, tasks.planner):
                # It was asked about a planner whose turn has not come.
                self._drop(slot, worker)
            elif worker is not None:
                worker.configure(setup)
        while not stop():
            self._renew()
            self._fill(tasks)
            if not tasks.left and not any(worker and worker.held for worker in self._workers):
                if not self._alone:
                    return
                tasks.requeue(self._alone.popleft())
            for key, _ in self._selector.select(_TICK_S):
                slot, event = key.data
                self._handle(slot, event, tasks, keep)
            self._watch(tasks, keep)
        for slot, worker in enumerate(self._workers):
            if worker is not None and worker.held:
                # It would go on, and write its trace behind our back.
                self._drop(slot, worker)

    def _served(self, setup: Setup) -> Setup:
        """The setup with an inference process, where a planner's batches pay: on a GPU always."""
        wanted = any(setup.device in planner["served_on"] for planner in setup.planners)
        if not wanted or (setup.device == "cpu" and self._crowd == 1):
            return setup
        from tsbench.run.execution.inference_client import InferenceServer

        if self._server is None:
            with io_errors_as_input_errors(Path("starting the inference process")):
                self._server = InferenceServer(setup.device)
        for slot, worker in enumerate(self._workers):
            if worker is not None and worker.planner:
                # It has a network of its own from being asked.
                self._drop(slot, worker)
        self._workers += [None] * (self._crowd - len(self._workers))
        return replace(setup, inference=self._server.address)

    def memory(self) -> list[MemoryUse]:
        """What the workers took, those that have ended included."""
        return [use for use in self._memory if use.episodes]

    def _renew(self) -> None:
        """Let go of workers that have grown too large; `_fill` starts others in their places."""
        if self._server is not None:
            self._server.revive()
        for slot, worker in enumerate(self._workers):
            if worker is not None and worker.outgrown and not worker.held:
                self._drop(slot, worker)

    def _fill(self, tasks: TaskQueue) -> None:
        """Give work to whoever has little. One episode waits ahead, so that no worker waits for us."""
        for slot in range(len(self._workers)):
            if not tasks.left:
                return
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
                worker.planner = self._spec_of(task)
                worker.send_task(task)

    def _spec_of(self, task: Task) -> str:
        assert self._setup is not None
        return str(self._setup.planners[task.planner]["spec"])

    def _index_of(self, spec: str) -> int | None:
        """Number of a planner, None where there is none yet."""
        assert self._setup is not None
        return [p["spec"] for p in self._setup.planners].index(spec) if spec else None

    def _unspoilt(self, slot: int, spec: str) -> WorkerProcess:
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

    def _handle(self, slot: int, event: str, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        worker = self._workers[slot]
        # None: it was buried by an event of the same round.
        if worker is not None:
            self._take_in(worker, event, keep)
            if worker.closed:
                self._handle_death(slot, tasks, keep)

    def _take_in(self, worker: WorkerProcess, event: str, keep: Callable[[Record], None]) -> None:
        if event == "log":
            if not worker.read_log():
                self._forget(worker.log_fd)
            return
        self._receive(worker, keep)
        worker.closed = worker.closed or event == "death"
        if worker.hung_up is not None:
            # Its end follows, or it is given up.
            self._forget(worker.connection)

    def _receive(self, worker: WorkerProcess, keep: Callable[[Record], None]) -> None:
        for message in worker.receive():
            if "ready" in message:
                worker.ready, worker.pid = True, int(message["ready"])
                worker.changed, worker.spent = time.monotonic(), None
            elif "task" not in message:
                worker.answer = message
            elif "fatal" in message:
                with io_errors_as_input_errors(Path()):
                    raise OSError(*message["fatal"])
            elif not worker.held or worker.held[0].number != message["task"]:
                # Not what it was asked for: nothing that it says can be trusted.
                worker.closed = True
                return
            else:
                worker.held.popleft()
                self._failed_starts = 0
                self._weigh(worker)
                keep(_with_output(message, worker))
                worker.drop_tail()

    def _weigh(self, worker: WorkerProcess) -> None:
        use, limits = worker.memory, self._limits
        use.take(resident_mb(worker.pid))
        worker.outgrown = use.last > limits.memory and use.episodes >= limits.least_episodes

    def _watch(self, tasks: TaskQueue, keep: Callable[[Record], None]) -> None:
        """End whoever has shown no sign of life for too long, or takes too much memory."""
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
        begun = worker.heartbeat.task in [task.number for task in worker.held]
        self._failed_starts = 0 if begun else self._failed_starts + 1
        if begun:
            task = worker.held.popleft()
            outside = overrun is None and not worker.broken and status in _FROM_OUTSIDE
            if overrun is not None and overrun.late and task.number not in self._tried_alone:
                self._tried_alone.add(task.number)
                self._alone.append(task)
            elif outside and task.number not in self._tried_twice:
                self._tried_twice.add(task.number)
                tasks.requeue(task)
            else:
                assert self._setup is not None
                keep(lost_record(worker, task, self._setup.planners[task.planner], status, overrun))
        for task in worker.held:
            tasks.requeue(task)
        if self._failed_starts >= _STILLBORN:
            said = worker.tail_text().splitlines() or ["it said nothing"]
            raise InputError(f"worker processes do not start ({cause_of_end(status)}): {said[-1]}")

    def _await_probe(self, probed: int, spec: str) -> dict[str, Any]:
        worker = self._workers[probed]
        assert worker is not None
        overrun = None
        while worker.answer is None and not worker.closed and overrun is None:
            for key, _ in self._selector.select(_TICK_S):
                slot, event = key.data
                other = self._workers[slot]
                if other is not None:
                    self._take_in(other, event, _no_record)
                    if other.closed and not other.planner:
                        self._drop(slot, other)
            worker.give_up(time.monotonic())
            overrun = find_overrun(worker, self._limits, time.monotonic())
        if worker.answer is not None:
            answer, worker.answer = worker.answer, None
            if "problem" in answer:
                raise InputError(answer["problem"])
            planner: dict[str, Any] = answer["planner"]
            return planner
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

    def _wait_for_ends(self, workers: Sequence[WorkerProcess]) -> None:
        """Until all have ended by themselves, or the time for that is over."""
        end = time.monotonic() + _SHUTDOWN_TIMEOUT_S
        waiting = {worker.death_fd for worker in workers}
        while waiting and (left := end - time.monotonic()) > 0:
            for key, _ in self._selector.select(left):
                if key.data[1] == "log" or key.fd in waiting:
                    waiting.discard(key.fd)
                    self._selector.unregister(key.fd)

    def _forget(self, file: Any) -> None:
        if file in self._selector.get_map():
            self._selector.unregister(file)


def _no_record(record: Record) -> None:
    raise AssertionError(f"a record before the first task: {record.row}")


def _with_output(message: Message, worker: WorkerProcess) -> Record:
    """A record as it came; where there was an error, with what the worker printed."""
    detail = message["detail"]
    if detail:
        worker.read_log()
        detail = f"{detail.rstrip()}\n\nOutput of the worker\n{worker.tail_text() or '  (none)'}\n"
    return Record(message["row"], message["events"], message["timing"], detail, message["trace"])
