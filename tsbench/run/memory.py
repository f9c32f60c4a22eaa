"""How much memory a process holds."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

_MB = 1e6


@dataclass
class MemoryUse:
    """Resident size of one worker, MB (1e6 bytes), taken after each of its episodes."""

    episodes: int = 0
    first: float = 0.0
    last: float = 0.0
    peak: float = 0.0

    def take(self, now: float) -> None:
        """One more episode."""
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
