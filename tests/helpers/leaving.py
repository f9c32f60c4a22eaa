"""Planners whose episodes leave a bit somewhere in their sandbox, outside their own process, for the next to find.

One that finds nothing is driven at 0.2 m/s2 and leaves the bit; one that finds it at 0.4.

python leaving.py OUT NAME...: drives both halves of a pair in sandboxes by each, and prints what they were driven at.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import mmap
import os
import platform
import resource
import signal
import socket
import stat
import struct
import sys
import threading
from contextlib import suppress
from pathlib import Path

from tsbench.planners.base import Control

SYSTEM = ctypes.CDLL(None)
IOPRIO_SET, IOPRIO_GET = {"x86_64": (251, 252), "aarch64": (30, 31)}[platform.machine()]
F_SETSIG, F_GETSIG, F_SETPIPE_SZ, F_GETPIPE_SZ = 10, 11, 1031, 1032


def line():
    """The socket to the referee."""
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(int(file.name)).st_mode):
                return socket.socket(fileno=os.dup(int(file.name)))
    raise OSError("no line")


class _Planner:
    found = False

    def reset(self, context):
        self.found = False
        with suppress(OSError):
            self.found = bool(self.finds())
        if not self.found:
            with suppress(OSError):
                self.leaves()

    def act(self, observation):
        return Control(0.4 if self.found else 0.2, 0.0)


class Nothing(_Planner):
    """Leaves nothing, so its sandbox is kept: its second process there has another number than its first."""

    def finds(self):
        return os.getpid() > 3

    def leaves(self):
        pass


# What finds a bit, and what leaves it.
BITS = {
    "Limit": (
        lambda: resource.getrlimit(resource.RLIMIT_NOFILE)[0] == 200,
        lambda: resource.prlimit(os.getppid(), resource.RLIMIT_NOFILE, (200, 256)),
    ),
    "Niceness": (
        lambda: os.getpriority(os.PRIO_PROCESS, 0) == 7,
        lambda: os.setpriority(os.PRIO_PROCESS, os.getppid(), 7),
    ),
    "NicenessOfGroup": (lambda: os.getpriority(os.PRIO_PROCESS, 0) == 7, lambda: os.setpriority(os.PRIO_PGRP, 0, 7)),
    "Processors": (
        lambda: os.sched_getaffinity(0) == {max(os.sched_getaffinity(os.getpid()))},
        lambda: os.sched_setaffinity(os.getppid(), {max(os.sched_getaffinity(0))}),
    ),
    "Policy": (
        lambda: os.sched_getscheduler(0) == os.SCHED_BATCH,
        lambda: os.sched_setscheduler(os.getppid(), os.SCHED_BATCH, os.sched_param(0)),
    ),
    "IoPriority": (
        lambda: SYSTEM.syscall(IOPRIO_GET, 1, 0) == (2 << 13 | 7),
        lambda: SYSTEM.syscall(IOPRIO_SET, 1, os.getppid(), 2 << 13 | 7),
    ),
    "LineOption": (
        lambda: line().getsockopt(socket.SOL_SOCKET, socket.SO_PRIORITY) == 5,
        lambda: line().setsockopt(socket.SOL_SOCKET, socket.SO_PRIORITY, 5),
    ),
    "LineName": (lambda: line().getsockname() == b"\0bit", lambda: line().bind(b"\0bit")),
    "LineSignal": (lambda: fcntl.fcntl(line(), F_GETSIG) == 12, lambda: fcntl.fcntl(line(), F_SETSIG, 12)),
    "LogSize": (lambda: fcntl.fcntl(1, F_GETPIPE_SZ) == 1 << 18, lambda: fcntl.fcntl(1, F_SETPIPE_SZ, 1 << 18)),
    "LogSignal": (lambda: fcntl.fcntl(2, F_GETSIG) == 12, lambda: fcntl.fcntl(2, F_SETSIG, 12)),
    "LogMode": (lambda: os.fstat(1).st_mode & 0o777 == 0o123, lambda: os.fchmod(1, 0o123)),
    "LogTime": (lambda: int(os.fstat(1).st_mtime) == 12, lambda: os.utime(1, (12, 12))),
}


def _planner(name, finds, leaves):
    return type(name, (_Planner,), {"finds": staticmethod(finds), "leaves": staticmethod(leaves)})


globals().update({name: _planner(name, *deeds) for name, deeds in BITS.items()})


class LogLock(_Planner):
    """Held by the open file, which lives as long as anybody has it."""

    def finds(self):
        return "lock:" in Path("/proc/self/fdinfo/2").read_text()

    def leaves(self):
        fcntl.flock(2, fcntl.LOCK_EX)


class LogRange(LogLock):
    def leaves(self):
        # F_OFD_SETLK of a byte.
        fcntl.fcntl(2, 37, struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, 7, 1, 0))


class Place(_Planner):
    """In a file that the constructor opened to read."""

    def __init__(self):
        self.file = os.open(__file__, os.O_RDONLY)

    def finds(self):
        return os.lseek(self.file, 0, os.SEEK_CUR) == 12

    def leaves(self):
        os.lseek(self.file, 12, os.SEEK_SET)


class Port(_Planner):
    """Of a connection that has ended: it stays in use for a minute."""

    PLACE = ("127.0.0.1", 4711)

    def finds(self):
        with socket.socket() as server:
            try:
                server.bind(self.PLACE)
            except OSError as problem:
                return problem.errno == 98
        return False

    def leaves(self):
        with socket.create_server(self.PLACE) as server, socket.create_connection(self.PLACE) as client:
            there, _ = server.accept()
            there.close()
            client.recv(1)


class Processes(_Planner):
    """In the numbers of processes, which are counted on."""

    def finds(self):
        return os.getpid() > 150

    def leaves(self):
        for _ in range(150):
            thread = threading.Thread(target=int)
            thread.start()
            thread.join()


class Files(_Planner):
    """In the numbers of files in memory."""

    def finds(self):
        path = Path("/tmp/file")
        path.touch()
        return path.stat().st_ino > 150

    def leaves(self):
        for _ in range(150):
            Path("/tmp/file").unlink()
            Path("/tmp/file").touch()
        Path("/tmp/file").unlink()


class FileTime(_Planner):
    def __init__(self):
        self.path = Path("/tmp/made")
        self.path.touch()

    def finds(self):
        return int(self.path.stat().st_mtime) == 12

    def leaves(self):
        os.utime(self.path, (12, 12))


class FileContent(FileTime):
    def finds(self):
        return self.path.read_text() == "bit"

    def leaves(self):
        self.path.write_text("bit")


class FileMemory(FileTime):
    """Written through memory that was read before, a file keeps its times."""

    def __init__(self):
        super().__init__()
        self.path.write_bytes(bytes(4096))

    def _memory(self):
        with self.path.open("r+b") as file:
            return mmap.mmap(file.fileno(), 4096)

    def finds(self):
        return self._memory()[0] == 1

    def leaves(self):
        memory = self._memory()
        memory[0] = memory[0] + 1


class FileRoom(FileMemory):
    """Where nothing was written, reading through memory takes room."""

    def __init__(self):
        self.path = Path("/tmp/made")
        with self.path.open("wb") as file:
            file.truncate(4096)

    def finds(self):
        return self.path.stat().st_blocks > 0

    def leaves(self):
        return self._memory()[0]


class HiddenFile(FileContent):
    """In a folder that its owner may not look into, and whose files are there by name."""

    def __init__(self):
        self.path = Path("/tmp/hidden/made")
        self.path.parent.mkdir()
        self.path.touch()
        self.path.parent.chmod(0o300)


class Nameless(_Planner):
    """A file without a name, held open to be read."""

    def __init__(self):
        path = Path("/tmp/nameless")
        path.touch()
        self.file = os.open(path, os.O_RDONLY)
        path.unlink()

    def finds(self):
        return os.fstat(self.file).st_size > 0

    def leaves(self):
        Path(f"/proc/self/fd/{self.file}").write_text("bit")


class ReadOnlyMemory(_Planner):
    """Shared, and not to be written until an episode says so."""

    def __init__(self):
        self.memory = mmap.mmap(-1, 4096, mmap.MAP_SHARED | mmap.MAP_ANONYMOUS, mmap.PROT_READ)

    def finds(self):
        return self.memory[0] == 1

    def leaves(self):
        lines = Path("/proc/self/maps").read_text().splitlines()
        for place in [int(line.split("-")[0], 16) for line in lines if " r--s " in line and "zero" in line]:
            SYSTEM.mprotect(ctypes.c_void_p(place), 4096, mmap.PROT_READ | mmap.PROT_WRITE)
            ctypes.memset(place, 1, 1)


class Semaphores(_Planner):
    """In the numbers of System V's semaphores, which are gone."""

    def finds(self):
        number = SYSTEM.semget(0, 1, 0o600)
        SYSTEM.semctl(number, 0, 0)
        return number > 0

    def leaves(self):
        pass


class Accounts(_Planner):
    """In the bytes that were read by the children which the process that episodes are forks of has waited for."""

    def finds(self):
        return int(Path(f"/proc/{os.getppid()}/io").read_text().split()[1]) > 1 << 30

    def leaves(self):
        with Path("/dev/zero").open("rb", buffering=0) as zero:
            for _ in range(1 << 10):
                zero.read(1 << 20)


class Handler(_Planner):
    """A signal has the process that episodes are forks of call what the constructor told it to."""

    def __init__(self):
        self.told = []
        signal.signal(signal.SIGUSR1, lambda *_: self.told.append(1))

    def finds(self):
        return self.told

    def leaves(self):
        os.kill(os.getppid(), signal.SIGUSR1)


class Daemon(_Planner):
    """A process that the constructor started, and that its own parent has left, lives on beside all episodes."""

    STRAYS = False

    def __init__(self):
        # PR_SET_CHILD_SUBREAPER: in a sandbox its next parent is bubblewrap's.
        if self.STRAYS:
            SYSTEM.prctl(36, 0, 0, 0, 0)
        middle = os.fork()
        if not middle:
            if not os.fork():
                # Nobody is to wait for the end of what it could print.
                os.closerange(0, 3)
                signal.alarm(20)
                signal.pause()
            os._exit(0)
        os.waitpid(middle, 0)


class Stray(Daemon):
    STRAYS = True


ALL = (
    *BITS, "LogLock", "LogRange", "Place", "Port", "Processes", "Files",
    "FileTime", "FileContent", "FileMemory", "FileRoom", "HiddenFile", "Semaphores", "Accounts",
)  # fmt: skip
IN_LOG = tuple(name for name in ALL if name.startswith("Log"))


def main(out, *names):
    import tsbench
    from tsbench.episode.trace import read_trace, trace_path

    run = tsbench.evaluate(
        [f"{Path(__file__).resolve()}:{name}" for name in names], split="dev", types=["speed_limit"], limit=2,
        workers=1, trace="all", isolate=True, out=Path(out),
    )  # fmt: skip
    told = {name: [] for name in names}
    for row in run.episodes.itertuples():
        assert row.error in (None, "") or row.error != row.error, row.error
        told[row.planner].append(float(read_trace(trace_path(Path(out), row.planner, row.scenario_id)).commands[0, 0]))
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:])
