"""The heartbeat of a worker: three words of shared memory that cost a worker a fraction of a microsecond."""

from __future__ import annotations

import mmap
import os
import tempfile

IDLE, LOADING, SIMULATING, PLANNING, SCORING = range(5)
PHASE_NAMES = (
    "between episodes",
    "loading the scene",
    "in the simulation",
    "in the planner",
    "in the monitors",
)
_SIZE = mmap.PAGESIZE
_PHASE_BITS = 4


def heartbeat_file() -> int:
    """A file descriptor of zeroed memory to share with a worker."""
    if hasattr(os, "memfd_create"):
        fd = os.memfd_create("tsbench-pulse")
    else:
        with tempfile.TemporaryFile() as file:
            fd = os.dup(file.fileno())
    os.ftruncate(fd, _SIZE)
    return fd


class Heartbeat:
    """Word 0: beats and phase in one, so that a reader never sees half of a beat. Word 1: how often the
    planner was entered in this task. Word 2: number of the task begun last (tasks count from 1).
    """

    def __init__(self, fd: int) -> None:
        self._words = memoryview(mmap.mmap(fd, _SIZE)).cast("q")
        self._beats = 0

    def begin(self, task: int) -> None:
        """A worker takes up a task."""
        self._words[1] = 0
        self._words[2] = task

    def beat(self, phase: int) -> None:
        """A worker enters a phase."""
        self._beats += 1
        if phase == PLANNING:
            self._words[1] += 1
        self._words[0] = self._beats << _PHASE_BITS | phase

    @property
    def stamp(self) -> int:
        """A number that differs after every beat."""
        return self._words[0]

    @property
    def phase(self) -> int:
        """The phase entered last."""
        return self._words[0] & ((1 << _PHASE_BITS) - 1)

    @property
    def planner_calls(self) -> int:
        """How often the planner was entered in this task, `reset` included."""
        return self._words[1]

    @property
    def task(self) -> int:
        """The task begun last, 0 = none yet."""
        return self._words[2]
