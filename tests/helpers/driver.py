"""`tsbench run` with the fake runner in place of the real one; takes the command line's arguments.

Environment: TSBENCH_TEST_LIMITS, JSON of limits; TSBENCH_TEST_PAUSE, a number of finished episodes at which the run
waits until it is told to go on; TSBENCH_TEST_FAULT, see `faults.py`.
"""

from __future__ import annotations

import json
import os
import signal
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import faults
from patience import HANG_S

import tsbench.cli
import tsbench.cli.run as command
from tsbench.run.execution.executor import Limits
from tsbench.run.log.journal import Journal
from tsbench.run.run_options import RunOptions

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


if __name__ == "__main__":
    faults.install()
    main()
