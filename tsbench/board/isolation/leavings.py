"""What an episode may leave behind in its planner's sandbox when its process and all that it started have ended."""

from __future__ import annotations

import ctypes
import fcntl
import os
import platform
import resource
import socket
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from tsbench.core.files import sha256_of

# Where every process of a sandbox may write.
_PUBLIC: Final = (Path("/tmp"), Path("/dev/shm"))
_OWN: Final = Path("/proc/self")
# Of the process that episodes are forks of; a container has a /proc that may be written to.
_SETTINGS: Final = ("oom_score_adj", "coredump_filter", "timerslack_ns", "autogroup")
_STATUS: Final = ("Sig", "Shd", "Cpus_allowed", "Mems_allowed", "Umask", "TracerPid", "Threads")
# Of a namespace: System V's objects; counts, ports and what waits for an end, of a network that leads nowhere.
_SHARED: Final = tuple(
    Path("/proc", folder, name)
    for folder, names in (("sysvipc", ("shm", "sem", "msg")), ("net", ("dev", "tcp", "tcp6", "udp", "udp6")))
    for name in names
)
_IOPRIO_GET: Final = {"x86_64": 252, "aarch64": 31}
_F_GETSIG, _F_GETPIPE_SZ = 11, 1032
_MOST_OPTIONS: Final = 100
# Options that tell what is waiting to be read, and open a file for each question. No process can set them.
_SO_MEMINFO, _SO_PEERPIDFD = 55, 77
# RLIMIT_RTTIME.
_LAST_LIMIT: Final = 15
_PROBE: Final = ".tsbench-next-number"
_State = dict[str, object]


class Leavings:
    """What a sandbox was like before an episode, to be compared with what it is like after it.

    line: to the referee. Nothing is put back: a sandbox in which something is left is one to be replaced.
    """

    def __init__(self, line: socket.socket) -> None:
        self._line = line
        # The first process of a namespace, as in a container, or the one that bubblewrap's first has started: no other
        # but its own children live, write and count in there.
        self._alone = os.getpid() <= 2
        home = Path(os.environ.get("HOME", "/tmp"))
        self._places = tuple(dict.fromkeys((home, *_PUBLIC))) if self._alone else ()
        self._begin()

    def nothing_left(self) -> bool:
        """Is the sandbox as it was before the episode that has ended? Begins the next one."""
        same = self._look() == self._before
        numbers = self._numbers
        self._begin()
        # A fork for the episode, and our own look at the numbers of files.
        return same and self._numbers == [number + 1 for number in numbers]

    def _begin(self) -> None:
        # Found by files and processes that are gone.
        self._numbers = [_next_number(place) for place in self._places]
        self._numbers += [_last_process()] if self._alone else []
        self._before = self._look()

    def _look(self) -> _State:
        found: _State = {
            "limits": [resource.getrlimit(kind) for kind in range(_LAST_LIMIT + 1)],
            "priority": (os.getpriority(os.PRIO_PROCESS, 0), _io_priority()),
            "schedule": (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)),
            "group": (os.getpgid(0), os.getsid(0)),
            "status": [line for line in _text(_OWN / "status").splitlines() if line.startswith(_STATUS)],
            "settings": [_text(_OWN / name) for name in _SETTINGS],
            "descriptors": dict(_descriptors()),
            "line": (self._line.getsockname(), _options(self._line)),
        }
        if self._alone:
            found["shared"] = [_text(path) for path in _SHARED]
            unread: list[object] = []
            found["files"] = [_told(path) for path in self._paths(unread)]
            found["unread"] = unread
        return found

    def _paths(self, unread: list[object]) -> Iterator[Path]:
        """All files and folders; not what is mounted there, such as the planner's own folder.

        unread: gets something that equals nothing for each folder that cannot be looked into.
        """
        for place in self._places:
            device = place.lstat().st_dev
            yield place
            for folder, folders, files in os.walk(place, onerror=lambda _: unread.append(object())):
                paths = [Path(folder, name) for name in sorted([*folders, *files])]
                own = [path for path in paths if path.lstat().st_dev == device]
                folders[:] = [path.name for path in own if path.is_dir() and not path.is_symlink()]
                yield from own


def _told(path: Path) -> tuple[object, ...]:
    """What differs after any change.

    By memory a file is changed at no time, and given room without a change. Read first: that changes when it was read.
    """
    content = None
    with suppress(OSError):
        if path.is_symlink():
            content = str(path.readlink())
        elif path.is_file():
            content = sha256_of(path)
    found = path.lstat()
    times = found.st_mtime_ns, found.st_ctime_ns
    return str(path), content, found.st_size, found.st_blocks, *times, found.st_ino


def _text(path: Path) -> str:
    with suppress(OSError):
        return path.read_text()
    return ""


def _next_number(place: Path) -> int:
    """The number of a new file: a file system in memory counts on, also after files are gone."""
    path = place / _PROBE
    file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    try:
        return os.fstat(file).st_ino
    finally:
        os.close(file)
        path.unlink()


def _last_process() -> int:
    """The number of the process or thread that was started last; they are counted on, too."""
    return int((_text(Path("/proc/loadavg")).split() or ["0"])[-1])


def _io_priority() -> int:
    number = _IOPRIO_GET.get(platform.machine())
    return ctypes.CDLL(None).syscall(number, 1, 0) if number else 0


def _descriptors() -> Iterator[tuple[str, object]]:
    """Of each open file what belongs to the file and not to the process, so that another process may change it."""
    for path in list((_OWN / "fd").iterdir()):
        file = int(path.name)
        told: list[object] = []
        with suppress(OSError):
            kind = os.fstat(file)
            told += [path.readlink(), _text(_OWN / "fdinfo" / path.name), kind.st_mode, kind.st_uid]
            told += [fcntl.fcntl(file, fcntl.F_GETOWN), fcntl.fcntl(file, _F_GETSIG)]
            if stat.S_ISFIFO(kind.st_mode):
                told.append(fcntl.fcntl(file, _F_GETPIPE_SZ))
                # When it was last written to is the planner's to set, where the pipe is its user's.
                os.utime(file)
            if stat.S_ISSOCK(kind.st_mode):
                told += [kind.st_mtime_ns, kind.st_ctime_ns, *os.listxattr(file)]
        # The folder that is being listed is closed by now.
        if told:
            yield path.name, told


def _options(line: socket.socket) -> dict[int, bytes]:
    found = {}
    for option in {*range(1, _MOST_OPTIONS)} - {_SO_MEMINFO, _SO_PEERPIDFD}:
        with suppress(OSError):
            found[option] = line.getsockopt(socket.SOL_SOCKET, option, 64)
    return found
