"""A temporary folder of one process; those of processes that were killed are removed by the next that makes one."""

from __future__ import annotations

import fcntl
import os
import shutil
import weakref
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir, mkdtemp

_PREFIXES = ("tsbench-actor-", "tsbench-sandbox-", "tsbench-files-")
ACTOR, SANDBOX, FILES = _PREFIXES


class OwnFolder:
    """path: the folder. Locked as long as this process lives: an unlocked folder has no owner."""

    def __init__(self, prefix: str) -> None:
        """prefix: ACTOR, SANDBOX or FILES. Raises OSError where the folder for temporary files takes nothing."""
        remove_abandoned()
        self.path, lock = _locked_folder(prefix)
        self._release = weakref.finalize(self, _released, self.path, lock)

    def remove(self) -> None:
        """Remove it; nothing happens the second time."""
        self._release()


def remove_abandoned() -> None:
    """Remove the folders of processes that were killed before they could do so themselves."""
    places = (path for prefix in _PREFIXES for path in Path(gettempdir()).glob(f"{prefix}*"))
    for path in sorted(places):
        # Of another user, or gone meanwhile: not ours to remove.
        with suppress(OSError):
            lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(path)
            finally:
                os.close(lock)


def _locked_folder(prefix: str) -> tuple[Path, int]:
    """A new folder, and the descriptor that holds its lock."""
    while True:
        path = Path(mkdtemp(prefix=prefix))
        try:
            lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue
        fcntl.flock(lock, fcntl.LOCK_EX)
        if path.is_dir():
            return path, lock
        # Another process took it for an abandoned one before it was locked.
        os.close(lock)


def _released(path: Path, lock: int) -> None:
    _remove(path)
    os.close(lock)


def _remove(path: Path) -> None:
    # What a planner without namespaces still writes there goes with the next that looks.
    shutil.rmtree(path, ignore_errors=True)
