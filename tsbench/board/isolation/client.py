"""A Python planner at the far end of the line. Started by `process` only, in its sandbox.

python -P -m tsbench.board.isolation.client SPEC

The line is descriptor 3, or in a container the socket that TSBENCH_LINE names. This is the reference for clients: who
speaks so, in any language, is a planner.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import platform
import resource
import socket
import stat
import sys
import traceback
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from tsbench.board.isolation import protocol
from tsbench.board.isolation.episode_messages import Decoder, command_message
from tsbench.core.errors import InputError, cause_in_planner
from tsbench.core.files import sha256_of
from tsbench.core.machine import adopt_orphans
from tsbench.core.text import written_out
from tsbench.planners.base import Planner, PlannerContext
from tsbench.planners.planner_spec import cause_with_place
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.execution.fresh_episode import end_as, run_in_child, shared_with_children

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
        # Of the process or thread that was started last; they are counted on, too.
        self._numbers += [int((_text(Path("/proc/loadavg")).split() or ["0"])[-1])] if self._alone else []
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


_ROOM_BYTES = 1 << 16
_LONGEST_TEXT = 100_000


class Client:
    """Hears what happens, and answers.

    leavings: of a planner whose episodes are each played by a child of this process, so that they begin in the state
    that its constructor left; None: this process plays them all.
    """

    def __init__(self, line: socket.socket, loaded: LoadedPlanner, planner: Planner, leavings: Leavings | None) -> None:
        self._line, self._loaded, self._leavings = line, loaded, leavings
        self._planner: Planner | None = planner
        self._decoder = Decoder()
        self._heard = os.fdopen(line.fileno(), "rb", _ROOM_BYTES, closefd=False)

    def serve(self) -> None:
        """Until the line is closed, or an episode has left something: the next needs a new sandbox."""
        while (message := self._message()) is not None:
            if self._leavings is not None and isinstance(message, protocol.ContextMessage):
                if not self._episode_in_child(message, self._leavings):
                    return
            else:
                self._hear(message)

    def _hear(self, message: protocol.Asked) -> None:
        asked = self._decoder.hear(message)
        if asked is not None:
            self._line.sendall(self._answer(asked))

    def _episode_in_child(self, context: protocol.ContextMessage, leavings: Leavings) -> bool:
        """One episode, up to its END, which is answered if nothing of it is left. Is nothing left?"""
        status = run_in_child(lambda: self._episode(context))
        if status is not None:
            end_as(status)
        if not leavings.nothing_left():
            return False
        # The referee may have gone.
        with suppress(OSError):
            self._line.sendall(protocol.frame(protocol.DoneMessage()))
        return True

    def _episode(self, context: protocol.ContextMessage) -> None:
        message: protocol.Asked | None = context
        while message is not None and not isinstance(message, protocol.EndMessage):
            self._hear(message)
            message = self._message()

    def _answer(self, asked: Any) -> bytes:
        try:
            # One that could not begin an episode is made anew, as in a process with the referee.
            if isinstance(asked, PlannerContext):
                if self._planner is None:
                    self._planner = self._loaded.factory()
                self._planner.reset(asked)
                return protocol.frame(protocol.DoneMessage())
            assert self._planner is not None
            output = self._planner.act(asked)
        except BaseException as problem:
            # Half a character, in what a planner says, is no reason to say nothing.
            detail = traceback.format_exc()[-_LONGEST_TEXT:].encode(errors="backslashreplace").decode()
            return protocol.frame(protocol.FailedMessage(cause_in_planner(problem)[:500], detail))
        return command_message(output)

    def _message(self) -> protocol.Asked | None:
        head = self._heard.read(protocol.HEAD.size)
        size = protocol.HEAD.unpack(head)[0] if len(head) == protocol.HEAD.size else 0
        body = self._heard.read(size)
        return self._decoder.read(body) if body and len(body) == size else None


def main(spec: str) -> None:
    line = _connected()
    try:
        adopt_orphans()
        before = shared_with_children()
        loaded = resolve(spec)
        planner = _made(loaded)
    except InputError as problem:
        line.sendall(protocol.frame(protocol.HelloMessage(protocol.VERSION, problem=written_out(str(problem)))))
        return
    forks = not (loaded.own or loaded.keeps_process or shared_with_children() - before)
    weights_file = loaded.weights.file if loaded.weights else None
    own = (loaded.name, loaded.privileged, loaded.sign_access, loaded.floor)
    facts = protocol.HelloMessage(protocol.VERSION, *own, weights_file, forks=forks, keeps_process=not forks)
    line.sendall(protocol.frame(facts))
    Client(line, loaded, planner, Leavings(line) if forks else None).serve()


def _connected() -> socket.socket:
    place = os.environ.pop("TSBENCH_LINE", "")
    if place:
        line = socket.socket(socket.AF_UNIX)
        line.connect(place)
        return line
    line = socket.socket(fileno=os.dup(protocol.LINE))
    os.close(protocol.LINE)
    return line


def _made(loaded: LoadedPlanner) -> Planner:
    try:
        return loaded.factory()
    except InputError:
        raise
    except BaseException as error:
        raise InputError(f"planner {loaded.spec!r}: cannot be made: {cause_with_place(error)}") from error


if __name__ == "__main__":
    main(sys.argv[1])
