"""Kills the process, or fills the disk, at the n-th time that Python opens, moves or removes a file of a folder.

TSBENCH_TEST_FAULT is KIND:N:FOLDER. kill: SIGKILL just before it happens. full: this and every later opening for
writing below FOLDER fails with ENOSPC. count: nothing happens, and FOLDER.count says how many there were.
"""

from __future__ import annotations

import atexit
import errno
import os
import signal
import sys
from pathlib import Path

EVENTS = ("open", "os.rename", "os.remove", "os.mkdir")


def install() -> None:
    text = os.environ.get("TSBENCH_TEST_FAULT")
    if text is None:
        return
    kind, number, folder = text.split(":", 2)
    seen = 0

    def watch(event: str, arguments: tuple) -> None:
        nonlocal seen
        if event not in EVENTS or not _below(arguments[0], folder):
            return
        writes = event == "os.mkdir" or (event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR))
        if event == "open" and not writes:
            return
        seen += 1
        if kind == "kill" and seen == int(number):
            os.kill(os.getpid(), signal.SIGKILL)
        if kind == "full" and seen >= int(number) and writes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(arguments[0]))

    sys.addaudithook(watch)
    if kind == "count":
        atexit.register(lambda: Path(f"{folder}.count").write_text(str(seen)))


def _below(path: object, folder: str) -> bool:
    if not isinstance(path, str | bytes | os.PathLike):
        return False
    return os.path.abspath(os.fsdecode(path)).startswith(os.path.abspath(folder))  # noqa: PTH100
