"""What an episode may leave in a planner's sandbox besides processes: files, and System V's shared memory."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

_MOST_BYTES = 64 << 20
# Where every process may write.
_PUBLIC = (Path("/tmp"), Path("/dev/shm"))
_IPC = Path("/proc/sysvipc")
_IPC_RMID = 0
# Name, size, time of the last change, number of the file: what differs after any write.
_State = tuple[tuple[str, int, int, int], ...]


class Belongings:
    """The files in a sandbox's writable places, to go back to after each episode.

    places: folders that are the sandbox's own. Raises OSError for more than 64 MB, or for files that cannot be read.
    """

    def __init__(self, places: tuple[Path, ...]) -> None:
        self._places = places
        found = list(self._paths())
        if sum(path.lstat().st_size for path in found) > _MOST_BYTES:
            raise OSError(f"more than {_MOST_BYTES >> 20} MB of files")
        self._files = {path: _content(path) for path in found}
        self._state = self._look()

    def restore(self) -> None:
        """Remove what is new, and write what was there before; removes System V's objects in a namespace of its own."""
        if _has_namespace():
            _remove_ipc()
        if self._look() == self._state:
            return
        for path in reversed(list(self._paths())):
            if path not in self._files or _content(path) != self._files[path]:
                path.rmdir() if _is_folder(path) else path.unlink()
        for path, content in self._files.items():
            if path.is_symlink() or path.exists():
                continue
            if content is None:
                path.mkdir()
            elif isinstance(content, Path):
                path.symlink_to(content)
            else:
                path.write_bytes(content)
        self._state = self._look()

    def _look(self) -> _State:
        told = ((str(path), path.lstat()) for path in self._paths())
        return tuple((name, found.st_size, found.st_ctime_ns, found.st_ino) for name, found in told)

    def _paths(self) -> Iterator[Path]:
        """All files and folders, parents first; not what is mounted there, such as the planner's own folder."""
        for place in self._places:
            device = place.lstat().st_dev
            for folder, folders, files in os.walk(place):
                paths = [Path(folder, name) for name in sorted([*folders, *files])]
                own = [path for path in paths if path.lstat().st_dev == device]
                folders[:] = [path.name for path in own if _is_folder(path)]
                yield from own


def own_places() -> tuple[Path, ...]:
    """The folders that this process may write to in its sandbox; outside of one, only its home."""
    home = Path(os.environ["HOME"])
    return tuple(dict.fromkeys((home, *_PUBLIC))) if _has_namespace() else (home,)


def _has_namespace() -> bool:
    """Is this process the first of a namespace, as in a container, or the one that bubblewrap's first has started?"""
    return os.getpid() <= 2


def _content(path: Path) -> bytes | Path | None:
    """Of a file its bytes, of a link its target, of a folder None."""
    if path.is_symlink():
        return path.readlink()
    return None if path.is_dir() else path.read_bytes()


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _remove_ipc() -> None:
    """Remove shared memory, semaphores and queues of this namespace."""
    system = ctypes.CDLL(None)
    calls: dict[str, Callable[[int], object]] = {
        "shm": lambda number: system.shmctl(number, _IPC_RMID, None),
        "sem": lambda number: system.semctl(number, 0, _IPC_RMID),
        "msg": lambda number: system.msgctl(number, _IPC_RMID, None),
    }
    for kind, remove in calls.items():
        with suppress(FileNotFoundError):
            for line in (_IPC / kind).read_text().splitlines()[1:]:
                remove(int(line.split()[1]))
