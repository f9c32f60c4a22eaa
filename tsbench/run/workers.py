"""The pool of workers: hands out episodes, notices who died or hangs; no episode costs another one."""

from __future__ import annotations

import selectors
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.errors import InputError
from tsbench.metrics.outcome import Outcome
from tsbench.run.executor import Limits
from tsbench.run.files import told_plainly
from tsbench.run.handout import HandOut, Task
from tsbench.run.memory import MemoryUse, resident_mb
from tsbench.run.process import Message, Setup, WorkerProcess, cause_of_end
from tsbench.run.pulse import PHASE_NAMES, PLANNING
from tsbench.run.record import Record, error_row, lost_timing

if TYPE_CHECKING:
    from tsbench.run.serving import InferenceServer

_TICK_S = 0.25
_FAREWELL_S = 2.0
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
        self._stillborn = 0
        self._tried_twice: set[int] = set()
        self._slow_starters: set[int] = set()

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
                worker.leave()
            self._wait_for_ends(idle)
        for worker in workers:
            worker.end()
        self._workers = [None] * len(self._workers)
        self._selector.close()
        if self._server is not None:
            self._server.close()

    def probe(self, specs: Sequence[str]) -> list[dict[str, Any]]:
        """What each planner is, asked in a worker: importing one may end a process, which shall not be ours."""
        found = []
        for spec in specs:
            worker = self._workers[0] or self._start(0)
            worker.send_probe(spec)
            found.append(self._await_probe(worker, spec))
        return found

    def run(
        self, setup: Setup, tasks: HandOut, keep: Callable[[Record], None], stop: Callable[[], bool]
    ) -> None:
        """Run all tasks: see `Executor`."""
        setup = self._setup = self._served(setup)
        for worker in self._workers:
            if worker is not None:
                worker.configure(setup)
        while not stop():
            self._renew()
            self._fill(tasks)
            if not tasks.left and not any(worker and worker.held for worker in self._workers):
                return
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
        from tsbench.run.serving import InferenceServer

        if self._server is None:
            with told_plainly(Path("starting the inference process")):
                self._server = InferenceServer(setup.device)
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

    def _fill(self, tasks: HandOut) -> None:
        """Give work to whoever has little. One episode waits ahead, so that no worker waits for us."""
        for slot in range(len(self._workers)):
            if not tasks.left:
                return
            worker = self._workers[slot] or self._start(slot)
            while self._takes_more(worker, tasks.left):
                task = tasks.next(slot)
                if task is None:
                    return
                if not worker.held:
                    worker.changed = time.monotonic()
                worker.send_task(task)

    def _takes_more(self, worker: WorkerProcess, left: int) -> bool:
        wanted = 2 if left > len(self._workers) else 1
        return worker.ready and not worker.outgrown and len(worker.held) < wanted

    def _start(self, slot: int) -> WorkerProcess:
        with told_plainly(Path("starting a worker process")):
            worker = WorkerProcess(time.monotonic())
        self._memory.append(worker.memory)
        if self._setup is not None:
            worker.configure(self._setup)
        self._workers[slot] = worker
        self._selector.register(worker.connection, selectors.EVENT_READ, (slot, "message"))
        self._selector.register(worker.log_fd, selectors.EVENT_READ, (slot, "log"))
        self._selector.register(worker.death_fd, selectors.EVENT_READ, (slot, "death"))
        return worker

    def _handle(self, slot: int, event: str, tasks: HandOut, keep: Callable[[Record], None]) -> None:
        worker = self._workers[slot]
        # None: it was buried by an event of the same round.
        if worker is not None:
            self._take_in(worker, event, keep)
            if worker.closed:
                self._bury(slot, tasks, keep)

    def _take_in(self, worker: WorkerProcess, event: str, keep: Callable[[Record], None]) -> None:
        if event == "log":
            if not worker.read_log():
                self._forget(worker.log_fd)
            return
        self._receive(worker, keep)
        worker.closed = worker.closed or event == "death"

    def _receive(self, worker: WorkerProcess, keep: Callable[[Record], None]) -> None:
        for message in worker.receive():
            if "ready" in message:
                worker.ready = True
                worker.changed = time.monotonic()
            elif "task" not in message:
                worker.answer = message
            elif "fatal" in message:
                with told_plainly(Path()):
                    raise OSError(*message["fatal"])
            elif not worker.held or worker.held[0].number != message["task"]:
                # Not what it was asked for: nothing that it says can be trusted.
                worker.closed = True
                return
            else:
                worker.held.popleft()
                self._stillborn = 0
                self._weigh(worker)
                keep(_with_output(message, worker))
                worker.drop_tail()

    def _weigh(self, worker: WorkerProcess) -> None:
        use, limits = worker.memory, self._limits
        use.take(resident_mb(worker.process.pid))
        worker.outgrown = use.last > limits.memory and use.episodes >= limits.least_episodes

    def _watch(self, tasks: HandOut, keep: Callable[[Record], None]) -> None:
        """Kill whoever has shown no sign of life for too long."""
        now = time.monotonic()
        for slot, worker in enumerate(self._workers):
            if worker is None or (worker.ready and not worker.held):
                continue
            if worker.pulse.stamp != worker.stamp:
                worker.stamp, worker.changed = worker.pulse.stamp, now
            limit = self._limit(worker)
            if now - worker.changed > limit:
                self._receive(worker, keep)
                self._bury(slot, tasks, keep, late=limit)

    def _limit(self, worker: WorkerProcess) -> float:
        if not worker.held:
            return self._limits.start
        if worker.pulse.phase != PLANNING:
            return self._limits.phase
        # A planner that once used up its long first call would do so in every episode.
        first = worker.pulse.planner_calls <= 2 and worker.held[0].planner not in self._slow_starters
        return self._limits.first_call if first else self._limits.call

    def _bury(
        self, slot: int, tasks: HandOut, keep: Callable[[Record], None], late: float | None = None
    ) -> None:
        """A worker is at its end: settle what it was doing, give back what it had not begun."""
        worker = self._workers[slot]
        assert worker is not None
        status = self._drop(slot, worker)
        begun = bool(worker.held) and worker.pulse.task == worker.held[0].number
        self._stillborn = 0 if begun else self._stillborn + 1
        if begun:
            task = worker.held.popleft()
            if late is None and status in _FROM_OUTSIDE and task.number not in self._tried_twice:
                self._tried_twice.add(task.number)
                tasks.give_back(task)
            else:
                if late is not None and worker.pulse.phase == PLANNING:
                    self._slow_starters.add(task.planner)
                keep(self._lost(worker, task, status, late))
        for task in worker.held:
            tasks.give_back(task)
        if self._stillborn >= _STILLBORN:
            said = worker.tail_text().splitlines() or ["it said nothing"]
            raise InputError(f"worker processes do not start ({cause_of_end(status)}): {said[-1]}")

    def _lost(self, worker: WorkerProcess, task: Task, status: int, late: float | None) -> Record:
        """The record of an episode that took its worker along."""
        assert self._setup is not None
        who: Mapping[str, Any] = self._setup.planners[task.planner]
        phase = worker.pulse.phase
        if late is not None and phase == PLANNING:
            outcome, error = Outcome.PLANNER_TIMEOUT, f"one call of the planner took more than {late:g} s"
        elif late is not None:
            outcome, error = Outcome.SIM_ERROR, f"no progress for {late:g} s {PHASE_NAMES[phase]}"
        else:
            outcome = Outcome.PLANNER_ERROR if phase == PLANNING else Outcome.SIM_ERROR
            error = f"the worker process ended {PHASE_NAMES[phase]}: {cause_of_end(status)}"
        row = error_row(task.spec, who["name"], who["privileged"], outcome, error)
        detail = f"{error}\n\nOutput of the worker\n{worker.tail_text() or '  (none)'}\n"
        timing = lost_timing(task.spec, who["name"], time.monotonic() - worker.changed)
        return Record(row, [], timing, detail)

    def _await_probe(self, worker: WorkerProcess, spec: str) -> dict[str, Any]:
        end = time.monotonic() + self._limits.start
        while worker.answer is None and not worker.closed and time.monotonic() < end:
            for key, _ in self._selector.select(_TICK_S):
                slot, event = key.data
                other = self._workers[slot]
                if other is not None:
                    self._take_in(other, event, _no_record)
                    if other.closed and other is not worker:
                        self._drop(slot, other)
        if worker.answer is not None:
            answer, worker.answer = worker.answer, None
            if "problem" in answer:
                raise InputError(answer["problem"])
            planner: dict[str, Any] = answer["planner"]
            return planner
        late = not worker.closed
        status = self._drop(0, worker)
        if late:
            raise InputError(f"--planner {spec}: was not imported within {self._limits.start:g} s")
        said = worker.tail_text().splitlines() or ["it said nothing"]
        raise InputError(
            f"--planner {spec}: importing it ended the process ({cause_of_end(status)}): {said[-1]}"
        )

    def _drop(self, slot: int, worker: WorkerProcess) -> int:
        """End a worker and leave its slot empty; returns its exit status."""
        for file in (worker.connection, worker.log_fd, worker.death_fd):
            self._forget(file)
        self._workers[slot] = None
        return worker.end()

    def _wait_for_ends(self, workers: Sequence[WorkerProcess]) -> None:
        """Until all have ended by themselves, or the time for that is over."""
        end = time.monotonic() + _FAREWELL_S
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
