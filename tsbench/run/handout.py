"""Which worker gets which episode: those on one network stay with one worker while that costs nothing."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from tsbench.scenarios.spec import ScenarioSpec


@dataclass(frozen=True)
class Task:
    """One episode to run. number: from 1, unique in a run; planner: index in the run's planners."""

    number: int
    planner: int
    spec: ScenarioSpec


class HandOut:
    """Tasks in chunks of one planner and network; a worker without a chunk takes from the longest left."""

    def __init__(self, tasks: Iterable[Task]) -> None:
        self._chunks: dict[tuple[int, str], deque[Task]] = {}
        for task in tasks:
            self._chunks.setdefault((task.planner, task.spec.net), deque()).append(task)
        self._fresh = deque(sorted(self._chunks))
        self._mine: dict[int, tuple[int, str]] = {}
        self._returned: deque[Task] = deque()
        self.left = sum(len(chunk) for chunk in self._chunks.values())

    def next(self, worker: int) -> Task | None:
        """The next task of a worker, None if none is left."""
        if self.left == 0:
            return None
        self.left -= 1
        if self._returned:
            return self._returned.popleft()
        mine = self._chunks.get(self._mine.get(worker, (-1, "")))
        if not mine:
            mine = self._chunks[self._take_chunk(worker)]
        return mine.popleft()

    def give_back(self, task: Task) -> None:
        """A task that its worker could not take up."""
        self._returned.append(task)
        self.left += 1

    def _take_chunk(self, worker: int) -> tuple[int, str]:
        old = self._mine.pop(worker, None)
        if old is not None and not self._chunks[old]:
            del self._chunks[old]
        while self._fresh:
            key = self._fresh.popleft()
            if self._chunks.get(key):
                self._mine[worker] = key
                return key
        # Nothing untouched is left: help with the longest chunk (the first of equals).
        return max(self._chunks, key=lambda key: len(self._chunks[key]))
