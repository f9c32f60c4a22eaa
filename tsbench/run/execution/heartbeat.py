"""The heartbeat of a worker: five words of shared memory that cost a worker a fraction of a microsecond."""

from __future__ import annotations

import mmap
import os

from tsbench.episode.outcome import Phase

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
