"""Which worker gets which episode: those on one network stay with one worker while that costs nothing."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

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
