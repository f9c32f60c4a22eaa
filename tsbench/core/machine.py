"""What this process may use of its machine, which processes another has started, and which process it ends with."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


def own_cores() -> int:
    return len(os.sched_getaffinity(0))


def children_of(pid: int | None = None) -> list[int]:
    """Ids of the processes that a process (None: this one) has started and not waited for yet; none once it has ended.

    It, its threads and its children may end while this looks: what has ended has none. (`Path.glob` would raise.)
    """
    folder, found = Path("/proc", "self" if pid is None else str(pid), "task"), []
    try:
        threads = list(folder.iterdir())
    except (FileNotFoundError, ProcessLookupError):
        return []
    for thread in threads:
        with suppress(FileNotFoundError, ProcessLookupError):
            found += [int(child) for child in (thread / "children").read_text().split()]
    return found


def adopt_orphans() -> None:
    """Ask the kernel to make this process the parent of what its descendants leave behind when they end."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def die_with(parent: int) -> None:
    """Ask the kernel to kill this process when `parent` (its id) ends; at once if it already has."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)
