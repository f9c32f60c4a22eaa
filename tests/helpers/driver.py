"""`tsbench run` with the fake runner in place of the real one; takes the command line's arguments.

Environment: TSBENCH_TEST_LIMITS, JSON of limits; TSBENCH_TEST_PAUSE, a number of finished episodes at which the run
waits until it is told to go on; TSBENCH_TEST_FAULT, KIND:N:FOLDER, at the n-th time
that Python opens, moves or removes a file of a folder. kill: SIGKILL just before it happens. full: this and every
later opening for writing below FOLDER fails with ENOSPC. count: nothing happens, and FOLDER.count says how many there
were.
"""

from __future__ import annotations

import atexit
import errno
import json
import os
import signal
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

from patience import HANG_S

import tsbench.cli
import tsbench.cli.run as command
from tsbench.run.execution.messages import Limits
from tsbench.run.log.journal import Journal
from tsbench.run.options import RunOptions

# Nothing but what sleeps for ever is as slow as this, on the busiest machine.
LIMITS = dict.fromkeys(("call", "first_call", "phase", "start"), HANG_S)


def main(arguments: list[str] | None = None) -> None:
    limits = {**LIMITS, **json.loads(os.environ.get("TSBENCH_TEST_LIMITS", "{}"))}
    runner = os.environ.get("TSBENCH_TEST_RUNNER", "fake_runner:FakeRunner")
    with ExitStack() as stack:

        def options(**given):
            # It was blocked at the start: no program can answer Ctrl-C before its first import is done.
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
            given["memory_limit"] = limits.get("most_memory", given["memory_limit"])
            return RunOptions(**given, runner=runner, limits=replace(Limits(), **limits))

        stack.enter_context(patch.object(command, "RunOptions", options))
        if "TSBENCH_TEST_PAUSE" in os.environ:
            stack.enter_context(patch.object(Journal, "append", pausing(Journal.append)))
        tsbench.cli.main(arguments)


def pausing(append):
    """Wait, deaf to nothing, once so many episodes are in the journal."""
    wanted, mark = int(os.environ["TSBENCH_TEST_PAUSE"]), Path(os.environ["TSBENCH_TEST_MARK"])

    def append_and_wait(self, record):
        append(self, record)
        if len(self.done) == wanted:
            mark.with_suffix(".paused").touch()
            while not mark.with_suffix(".go").exists():
                time.sleep(0.005)

    return append_and_wait


EVENTS = ("open", "os.rename", "os.remove", "os.mkdir")


def install_fault() -> None:
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


if __name__ == "__main__":
    install_fault()
    main()
