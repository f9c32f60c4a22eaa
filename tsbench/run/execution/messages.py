"""What a run and its workers tell each other: one message in each line, its kind and its fields as JSON.

Floats come back bit for bit, and nothing is pickled: what a planner writes there is refused and runs nothing.
Tasks on one network stay with one worker while that costs nothing. The heartbeat of a worker is five words of shared
memory, which cost it a fraction of a microsecond.
"""

from __future__ import annotations

import json
import mmap
import os
import random
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol, Self, TypeVar

from tsbench.core.machine import MemoryUse
from tsbench.core.typed import typed
from tsbench.episode.outcome import Phase
from tsbench.episode.perception_level import Perception
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

_Key = tuple[int, str]
# No planner can know what it gives.
_draw = random.SystemRandom().random


@dataclass(frozen=True)
class Task:
    """One episode to run. number: from 1, unique in a run; planner: index in the run's planners."""

    number: int
    planner: int
    spec: ScenarioSpec


class TaskQueue:
    """Tasks in chunks of one planner and network, planner by planner; an idle worker takes from the longest.

    The order of chunks, and of tasks in them, is drawn by the system's randomness, and changes no row. A planner can
    count the episodes before by process numbers and by the clock; with a known order the count would name the half.
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._chunks: dict[_Key, deque[Task]] = {}
        for task in sorted(tasks, key=lambda _: _draw()):
            self._chunks.setdefault((task.planner, task.spec.net), deque()).append(task)
        self._fresh: dict[int, deque[_Key]] = {}
        for key in sorted(self._chunks, key=lambda key: (key[0], _draw())):
            self._fresh.setdefault(key[0], deque()).append(key)
        self._mine: dict[int, _Key] = {}
        self._returned: deque[Task] = deque()
        self._alone: deque[Task] = deque()
        self._retried: set[tuple[int, bool]] = set()
        self.left = sum(len(chunk) for chunk in self._chunks.values())

    @property
    def planner(self) -> int:
        """Whose turn it is: the first planner with tasks left."""
        return min(key[0] for key in self._chunks)

    def next(self, worker: int, planner: int | None = None) -> Task | None:
        """The next task of a worker, None if none is left; planner: of this planner only."""
        task = self._take_returned(planner) or self._take(worker, planner)
        self.left -= task is not None
        return task

    def requeue(self, task: Task) -> None:
        """A task that its worker could not take up."""
        self._returned.append(task)
        self.left += 1

    def retry(self, task: Task, alone: bool) -> bool:
        """Another try for a task that cost its worker, one of each kind; alone: at the end, when no other runs.

        False where it has had that try.
        """
        if (task.number, alone) in self._retried:
            return False
        self._retried.add((task.number, alone))
        if alone:
            self._alone.append(task)
        else:
            self.requeue(task)
        return True

    def requeue_alone(self) -> bool:
        """No task is left and none runs: bring back one that is to run alone. False without one."""
        if not self._alone:
            return False
        self.requeue(self._alone.popleft())
        return True

    def _take_returned(self, planner: int | None) -> Task | None:
        for task in self._returned:
            if planner in (None, task.planner):
                self._returned.remove(task)
                return task
        return None

    def _take(self, worker: int, planner: int | None) -> Task | None:
        key = self._mine.get(worker)
        if key not in self._chunks or planner not in (None, key[0]):
            key = self._take_chunk(worker, planner)
        if key is None:
            return None
        task = self._chunks[key].popleft()
        if not self._chunks[key]:
            del self._chunks[key]
        return task

    def _take_chunk(self, worker: int, planner: int | None) -> _Key | None:
        for number in list(self._fresh) if planner is None else [planner]:
            while keys := self._fresh.get(number):
                key = keys.popleft()
                if key in self._chunks:
                    self._mine[worker] = key
                    return key
            # Nothing untouched of this planner is left: help with the longest chunk (the first of equals).
            left = [key for key in self._chunks if key[0] == number]
            if left:
                return max(left, key=lambda key: len(self._chunks[key]))
        return None


M = TypeVar("M")

RUNNER = "tsbench.episode.runner:EpisodeRunner"
# What isolates planners is no part of the bench: it is loaded by name.
ISOLATED = "tsbench.board.isolation.isolated_loading"


@dataclass(frozen=True)
class Setup:
    """What all workers of a run are told.

    planners: by `Task.planner`. device: where their networks run. out: the run folder, for traces. trace: none,
    violations, all. data, split, contract: what a worker on another machine must have too. runner: module:Class of
    what runs episodes, made with a `LoadedPlanner`, `perception`, `heartbeat`, `data` and `options`; recorder:
    module:function from its result to a record. loader: module:function from a `PlannerInfo` and `hidden` to a
    `LoadedPlanner`, "" = planners run in the worker; hidden: what they must not find.
    """

    planners: tuple[PlannerInfo, ...]
    perception: Perception
    device: str
    trace: str
    out: str
    data: DataSet
    split: str
    contract: str
    runner: str = RUNNER
    recorder: str = "tsbench.run.log.record:make_record"
    options: Mapping[str, Any] = field(default_factory=dict)
    loader: str = ""
    hidden: tuple[str, ...] = ()


@dataclass(frozen=True)
class Start:
    """The first thing that a worker is told. sys_path: the run's, on which its planners are."""

    sys_path: tuple[str, ...]


@dataclass(frozen=True)
class Probe:
    """The question what a planner is. device: where its network runs."""

    spec: str
    device: str = "cpu"


@dataclass(frozen=True)
class Ready:
    """A worker has come up as this process."""

    pid: int


@dataclass(frozen=True)
class Probed:
    """The facts of a planner, or in one line the reason why it has none."""

    planner: PlannerInfo | None
    problem: str = ""


@dataclass(frozen=True)
class Finished:
    """The record of a task, by its number."""

    task: int
    record: Record


@dataclass(frozen=True)
class FolderFailed:
    """The run folder takes nothing more: an OSError, for the whole run to stop."""

    errno: int
    reason: str
    filename: str


@dataclass(frozen=True)
class Refused:
    """Why a machine takes no part, or what ends the run there."""

    problem: str


TO_WORKER = (Start, Setup, Probe, Task)
TO_RUN = (Ready, Probed, Finished, FolderFailed)


def encode(message: Any) -> bytes:
    return json.dumps([type(message).__name__, asdict(message)]).encode() + b"\n"


def decode(line: bytes | str, kinds: tuple[type[M], ...]) -> M:
    """The message of a line, one of these kinds. Raises ValueError or RecursionError for foreign ones."""
    told = json.loads(line)
    if not isinstance(told, list) or len(told) != 2:
        raise ValueError("no message of a worker")
    for kind in kinds:
        if kind.__name__ == told[0]:
            return typed(kind, told[1])
    raise ValueError(f"no message of a worker: {told[0]!r:.80}")


_SIZE = mmap.PAGESIZE
_PHASE_BITS = 4


def heartbeat_file() -> int:
    """A file descriptor of zeroed memory to share with a worker."""
    fd = os.memfd_create("tsbench-heartbeat")
    os.ftruncate(fd, _SIZE)
    return fd


class Heartbeat:
    """Word 0: beats and phase in one, so that a reader never sees half of a beat. Word 1: how often the
    planner was entered in this task. Word 2: number of the task begun last (tasks count from 1). Word 3: the process
    that plays it. Word 4: has the planner left something outside its process (`opened_files`)?
    """

    def __init__(self, fd: int) -> None:
        self._words = memoryview(mmap.mmap(fd, _SIZE)).cast("q")
        self._beats = 0

    def begin(self, task: int) -> None:
        self._words[1] = 0
        self._words[2] = task
        self._words[3] = os.getpid()
        # A child may have played the task before: beats go on where it ended.
        self._beats = self._words[0] >> _PHASE_BITS

    def beat(self, phase: int) -> None:
        self._beats += 1
        if phase == Phase.PLANNING:
            self._words[1] += 1
        self._words[0] = self._beats << _PHASE_BITS | phase

    def leave(self) -> None:
        self._words[4] = 1

    @property
    def left(self) -> bool:
        return bool(self._words[4])

    @property
    def stamp(self) -> int:
        """A number that differs after every beat."""
        return self._words[0]

    @property
    def phase(self) -> Phase:
        return Phase(self._words[0] & ((1 << _PHASE_BITS) - 1))

    @property
    def planner_calls(self) -> int:
        """How often the planner was entered in this task, `reset` included."""
        return self._words[1]

    @property
    def player(self) -> int:
        """Id of the process that plays the task begun last, 0 = none yet."""
        return self._words[3]

    @property
    def task(self) -> int:
        """The task begun last, 0 = none yet."""
        return self._words[2]


@dataclass(frozen=True)
class Limits:
    """How long a worker may show no sign of life, s of its processor time, and how large it may become, MB.

    call: in one call of the planner; first_call: making it, `reset` and the first `act` of an episode;
    phase: loading, simulating, scoring; start: being asked what a planner is. patience: wall-clock limit as a
    multiple of these, because a sleeping planner uses no processor. most_memory: resident size of a worker and
    all that it has started, over which it is ended at once. memory: its own size over which it is replaced between
    two episodes, though not before its `least_episodes`-th, so that a planner that needs as much is not loaded again
    for each.
    """

    call: float = 10.0
    first_call: float = 60.0
    phase: float = 60.0
    start: float = 120.0
    patience: float = 5.0
    most_memory: float = 4096.0
    memory: float = 2048.0
    least_episodes: int = 20


class Executor(Protocol):
    """Runs episodes somewhere; used in a `with` block, whose end leaves no process behind."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, *_: object) -> None: ...

    def probe(self, specs: Sequence[str], device: str = "cpu") -> list[PlannerInfo]:
        """What each planner is, made with its network on a device.

        Raises InputError: it does not exist, does not import, cannot be made there, or takes too long to.
        """

    def run(self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]) -> None:
        """Run all tasks; `keep` gets each record as it comes, once its trace lies in the run folder.

        Ends early once `stop` says so. Raises InputError: the run folder takes nothing more, or no worker is left.
        """

    def memory(self) -> list[MemoryUse]:
        """What the workers of this machine took, those that have ended included."""
