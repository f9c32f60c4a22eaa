"""An episode in a child of the worker, so that it begins in the state that the planner's constructor left.

The worker makes the planner and loads the roads, and never plays. A child plays one episode and ends. What it changed
in objects, classes and modules ends with it, and so do the processes that it started. Files that a planner writes
outlive it: only an isolated planner (`board.isolation`) shares none with other episodes.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import os
import re
import signal
import stat
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tsbench.core.machine import adopt_orphans, children_of, die_with

# Comes with PyArrow, and is started anew in a child.
_ALLOCATOR = "jemalloc_bg_thd"
_NOTHING = Path("/dev/null")
_MAPPING = re.compile(r"[0-9a-f]+-[0-9a-f]+ ")
# In a namespace of processes: bubblewrap's is 1, a container's own program is.
_FIRST_OF_SANDBOX = 2


def shared_with_children() -> frozenset[str]:
    """What children of a fork would share with this process and with each other, or would miss; in words.

    Threads, child processes, handlers of signals, memory that is shared, and open files that are not only read. What
    the constructor of a planner adds to it can carry something from one episode to the next.
    """
    own = Path("/proc/self")
    found = set()
    for thread in (own / "task").iterdir():
        # One that ends meanwhile is nothing that is shared.
        with suppress(FileNotFoundError, ProcessLookupError):
            if (thread / "comm").read_text().strip() != _ALLOCATOR:
                found.add(f"thread {thread.name}")
    found |= {f"process {child}" for child in _others()}
    # A child may send signals to this process.
    for number in signal.valid_signals():
        handler = signal.getsignal(number)
        if handler not in (signal.SIG_DFL, signal.SIG_IGN):
            found.add(f"handler {handler!r} of signal {number}")
    # What is not to be written to now may be made so later, if the kernel holds it for shared.
    told = ""
    for line in (own / "smaps").read_text().splitlines():
        if _MAPPING.match(line):
            told = line
        elif line.startswith("VmFlags:") and {"sh", "mw"} <= {*line.split()}:
            place, _, _, _, _, *name = told.split(maxsplit=5)
            found.add(f"shared memory {' '.join(name)} at {place}")
    for file in (own / "fd").iterdir():
        with suppress(OSError):
            target = file.readlink()
            flags = re.search(r"flags:\s+(\d+)", (own / "fdinfo" / file.name).read_text())
            only_read = flags is not None and not int(flags[1], 8) & (os.O_WRONLY | os.O_RDWR)
            # Nothing shows whether a file without a name was opened anew to be written.
            only_read = only_read and os.fstat(int(file.name)).st_nlink > 0
            if target != _NOTHING and not (only_read and target.is_absolute()):
                found.add(f"open file {target} as {file.name}")
    return frozenset(found)


def _others() -> set[int]:
    """Processes that this one has started; in a sandbox all but its first: one may have been given another parent."""
    own = os.getpid()
    if own > _FIRST_OF_SANDBOX:
        return {*children_of()}
    return {int(path.name) for path in Path("/proc").iterdir() if path.name.isdecimal()} - {1, own}


def run_in_child(play: Callable[[], object]) -> int | None:
    """Run `play` in a child of this process.

    Returns None where `play` returned, else how the child ended: its exit code, or a signal's number, negative. All
    other children of this process, and what the child has started, are killed after its end.
    """
    adopt_orphans()
    # The collector of garbage would write to every object, and so copy every page.
    gc.collect()
    gc.freeze()
    parent = os.getpid()
    # What the child has started may hold the other end open: do not wait for that.
    returned, to_parent = os.pipe()
    os.set_blocking(returned, False)
    with _accounts_kept() as restore:
        child = os.fork()
        if not child:
            status = 1
            try:
                restore()
                die_with(parent)
                _reopen_files()
                play()
                os.write(to_parent, b"1")
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                with suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(status)
        status = _end_of(child)
        kill_children()
    os.close(to_parent)
    with os.fdopen(returned, "rb", buffering=0) as told:
        return None if told.read(1) else status


class _Action(ctypes.Structure):
    """The C library's `struct sigaction`."""

    _fields_ = (
        ("handler", ctypes.c_void_p),
        ("mask", ctypes.c_ubyte * 128),
        ("flags", ctypes.c_int),
        ("restorer", ctypes.c_void_p),
    )


_NO_STOPPED, _NO_WAIT = 1, 2


@contextmanager
def _accounts_kept() -> Iterator[Callable[[], None]]:
    """Within it the kernel adds nothing of children that end to the accounts of this process.

    All its children can read those: time, faults of pages, bytes that were read. Gives what a child is to call first.
    """
    before, system = _Action(), ctypes.CDLL(None)
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    system.sigaction(signal.SIGCHLD, ctypes.byref(_Action(flags=_NO_STOPPED | _NO_WAIT)), ctypes.byref(before))

    def restore() -> None:
        system.sigaction(signal.SIGCHLD, ctypes.byref(before), None)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    try:
        yield restore
    finally:
        restore()


# A signal that is lost, as two at once are, is missed for so long.
_LOOK_S = 0.1


def _end_of(child: int) -> int:
    """How a child ended. No call tells it where children leave no accounts, but the signal of its end does."""
    while True:
        told = signal.sigtimedwait({signal.SIGCHLD}, _LOOK_S)
        if told is not None and told.si_pid == child and told.si_code > 0:
            return told.si_status if told.si_code == os.CLD_EXITED else -told.si_status
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            # Its signal came together with that of another child.
            return -signal.SIGKILL


def _reopen_files() -> None:
    """Of files that are only read, open each anew: a child shares their places with its parent otherwise."""
    for path in list(Path("/proc/self/fd").iterdir()):
        file = int(path.name)
        # The folder that is listed is closed by now; what may not be opened again is not the planner's to read.
        with suppress(OSError):
            flags, kind = fcntl.fcntl(file, fcntl.F_GETFL), os.fstat(file).st_mode
            only_read = not flags & (os.O_WRONLY | os.O_RDWR | os.O_PATH)
            if only_read and (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                own = os.open(path, flags)
                os.lseek(own, os.lseek(file, 0, os.SEEK_CUR), os.SEEK_SET)
                os.dup2(own, file, os.get_inheritable(file))
                os.close(own)


def end_as(status: int) -> None:
    """End this process as a child ended: by the same signal or with the same exit code.

    The first process of a namespace can be ended by no signal of its own: its exit code is 128 and the signal's number.
    """
    if status < 0:
        if -status not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    os._exit(128 - status if status < 0 else status)


def kill_children() -> None:
    """Kill and reap all that this process has started, and what that has started."""
    if os.getpid() == 1:
        # The first process of a namespace: the others in it are all below it, and /proc may be missing.
        with suppress(ProcessLookupError):
            os.kill(-1, signal.SIGKILL)
        with suppress(ChildProcessError):
            while True:
                os.waitpid(-1, 0)
    while children := children_of():
        for child in children:
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(-1, 0)
