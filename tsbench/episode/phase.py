"""What a process that runs episodes is doing, for its watchdog."""

from __future__ import annotations

from enum import IntEnum


class Phase(IntEnum):
    """Told at each change; PLANNING is the planner's own time, making it and `reset` included."""

    IDLE = 0
    LOADING = 1
    SIMULATING = 2
    PLANNING = 3
    SCORING = 4

    @property
    def words(self) -> str:
        return _WORDS[self]


_WORDS = (
    "between episodes",
    "loading the scene",
    "in the simulation",
    "in the planner",
    "in the monitors",
)
