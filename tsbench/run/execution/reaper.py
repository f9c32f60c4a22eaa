"""Stands between a run and one worker process: whatever that starts ends with it, and both end with the run.

python -I -S reaper.py PARENT_PID DATA_BYTES WORKER_COMMAND...

The worker's command gets the reaper's process id as its last argument. Nothing of ours is imported, so that this starts
in an instant. What loses its parent below it becomes its own child, in whatever session or group it is: after the
worker's end all of these are killed. It ends as the worker did, by signal or exit code.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import time
from pathlib import Path

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_HEARD = (signal.SIGTERM, signal.SIGCHLD)
# What still makes new processes faster than they can be killed is left to the system.
_PATIENCE_S = 5.0


def start(command: list[str]) -> int:
    """Start the worker in a session of its own; returns its process id."""
    pid = os.fork()
    if pid:
        return pid
    os.setsid()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _HEARD)
    os.execv(command[0], [*command, str(os.getppid())])
    raise AssertionError("execv returned")


def wait(worker: int) -> int:
    """The worker's exit status (negative: a signal), once it has ended or we are told to end it."""
    while True:
        if signal.sigwait(_HEARD) == signal.SIGTERM:
            os.kill(worker, signal.SIGKILL)
        # One signal may stand for several children.
        while (found := os.waitpid(-1, os.WNOHANG)) != (0, 0):
            if found[0] == worker:
                return os.waitstatus_to_exitcode(found[1])


def kill_all() -> None:
    """Kill and reap until no process is left below us."""
    end = time.monotonic() + _PATIENCE_S
    while time.monotonic() < end:
        for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split():
            os.kill(int(child), signal.SIGKILL)
        try:
            if os.waitpid(-1, os.WNOHANG) == (0, 0):
                time.sleep(0.001)
        except ChildProcessError:
            return


def main(arguments: list[str]) -> None:
    parent, data_bytes, command = int(arguments[0]), int(arguments[1]), arguments[2:]
    signal.pthread_sigmask(signal.SIG_BLOCK, _HEARD)
    system = ctypes.CDLL(None)
    system.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    system.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if data_bytes:
        resource.setrlimit(resource.RLIMIT_DATA, (data_bytes, data_bytes))
    worker = start(command)
    # The line to the run is the worker's alone: it has to close when the worker ends.
    os.closerange(3, 1 << 16)
    status = wait(worker)
    kill_all()
    if status < 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [-status])
        os.kill(os.getpid(), -status)
    os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1:])
