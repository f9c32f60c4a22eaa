"""How much memory a process holds, and how long it has computed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from tsbench.core.machine import children_of

_MB = 1e6


@dataclass
class MemoryUse:
    """Resident size of one worker, MB (1e6 bytes), taken after each of its episodes."""

    episodes: int = 0
    first: float = 0.0
    last: float = 0.0
    peak: float = 0.0

    def take(self, now: float) -> None:
        self.episodes += 1
        self.first = self.first or now
        self.last, self.peak = now, max(self.peak, now)


def resident_mb(pid: int) -> float:
    """Resident size of a process, 0 where it has ended."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return int(pages) * os.sysconf("SC_PAGE_SIZE") / _MB


def resident_below_mb(pid: int) -> float:
    """Resident size of all that a process has started and that still runs."""
    return sum(resident_mb(child) + resident_below_mb(child) for child in children_of(pid))


def processor_s(pid: int) -> float:
    """Processor time that a process has used, s, to 0.01; 0 where it has ended."""
    try:
        # The name in parentheses may hold anything.
        told = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return (int(told[11]) + int(told[12])) / os.sysconf("SC_CLK_TCK")
