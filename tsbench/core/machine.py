"""What processes share of this machine: cores, memory and processor time; which ends with which, and how."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_NEW_OBJECTS = 20_000


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


def collect_garbage_seldom() -> None:
    """Let the garbage collector look at objects seldom: imports make many that all stay, a quarter of their time."""
    gc.set_threshold(_NEW_OBJECTS)


def module_command(module: str, python: str = sys.executable) -> list[str]:
    """What runs a module as `python -P -u -m` does, and collects garbage seldom from before its imports on."""
    run = f"runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    return [python, "-P", "-u", "-c", f"import gc, runpy; gc.set_threshold({_NEW_OBJECTS}); {run}"]


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


# One simulation is one thread; maths libraries that start one thread per core only get in each other's way, and how
# many there are decides how their sums are rounded.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "ARROW_IO_THREADS"), "1"
)


def cause_of_end(status: int) -> str:
    """An exit status in words."""
    if status >= 0:
        return f"exit code {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"signal {-status}"


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes that are started meanwhile do their maths with one thread, as a run's do: more wait for each other.

    With two busy cores a student's product took 3 ms instead of 0.1.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
