"""Planners that do what planners must not do. Each misbehaves in the scenario of seed 107 only."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

import numpy as np

from tsbench.planners.base import Control, Trajectory


class Good:
    def reset(self, context):
        self.gain = 0.1 * (context.seed % 5)

    def act(self, observation):
        return Control(self.gain, 0.0)


class Bad(Good):
    def reset(self, context):
        super().reset(context)
        self.bad = context.seed == 107

    def act(self, observation):
        return self.misbehave() if self.bad else super().act(observation)


def _bad(name, deed):
    return type(name, (Bad,), {"misbehave": lambda self: deed()})


ReturnsNone = _bad("ReturnsNone", lambda: None)
Nan = _bad("Nan", lambda: Control(float("nan"), 0.0))
Inf = _bad("Inf", lambda: Control(0.0, float("inf")))
WrongShape = _bad("WrongShape", lambda: Trajectory(np.arange(1.0, 4.0), np.zeros((2, 3))))
Sleeps = _bad("Sleeps", lambda: time.sleep(3600))
Exits = _bad("Exits", lambda: os._exit(7))
SysExits = _bad("SysExits", lambda: sys.exit("bye"))


class Raises(Bad):
    def misbehave(self):
        raise RuntimeError(f"no idea what to do with {object()}")


class Prints(Bad):
    def misbehave(self):
        print("x" * 100_000)
        os.write(2, b"y" * 100_000)
        return Control(0.0, 0.0)


class PrintsAndRaises(Bad):
    def misbehave(self):
        print("noise " * 100_000, "last \x1b[2J words")
        raise ValueError("enough")


class Segfaults(Bad):
    def misbehave(self):
        os.kill(os.getpid(), signal.SIGSEGV)
        time.sleep(60)


class KilledAlways(Bad):
    def misbehave(self):
        os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(60)


class KilledOnce(Bad):
    """Killed from outside the first time: the file remembers."""

    def misbehave(self):
        mark = Path(os.environ["TSBENCH_TEST_MARK"])
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(60)
        return Control(0.0, 0.0)


class LeavesChild(Bad):
    def misbehave(self):
        pid = os.fork()
        if pid == 0:
            time.sleep(3600)
        Path(os.environ["TSBENCH_TEST_MARK"]).write_text(str(pid))
        os._exit(3)


class Forks(Bad):
    def misbehave(self):
        self.bad = False
        os.fork()
        return Control(0.0, 0.0)


class Misdeed:
    """What `Hostile` does once, in an episode of its own."""


class OwnNumber(Misdeed):
    """A number that ends the process when it is read."""

    class Number:
        def __float__(self):
            raise SystemExit("read")

    def misbehave(self):
        return Control(self.Number(), 0.0)


class Own(BaseException):
    """A planner's own exception."""


class Mute(Exception):
    """An exception whose text raises."""

    def __str__(self):
        raise RuntimeError("no text")


class Raised(Misdeed):
    def __init__(self, make):
        self.make = make

    def misbehave(self):
        raise self.make()


def lines_to_the_run():
    """Descriptors of the worker's sockets."""
    found = [fd for fd in Path("/proc/self/fd").iterdir() if fd.is_symlink()]
    return [int(fd.name) for fd in found if str(fd.readlink()).startswith("socket:")]


class ClosesAll(Misdeed):
    def misbehave(self):
        os.closerange(0, 1024)
        return Control(0.0, 0.0)


class TakesLine(Misdeed):
    """Something else stands where the line to the run was."""

    def misbehave(self):
        null = os.open(os.devnull, os.O_RDWR)
        for fd in lines_to_the_run():
            os.dup2(null, fd)
        return Control(0.0, 0.0)


class WritesLine(Misdeed):
    def misbehave(self):
        for fd in lines_to_the_run():
            socket.socket(fileno=os.dup(fd)).sendall(b'{"task": 1}\n[]\n\x00\xff')
        return Control(0.0, 0.0)


class Gorges(Misdeed):
    """Takes 480 MB, and keeps them."""

    def misbehave(self):
        self.kept = [np.ones(60_000_000)]
        time.sleep(3600)


class ChildGorges(Misdeed):
    def misbehave(self):
        code = "import time; kept = b'x' * 520_000_000; time.sleep(3600)"
        subprocess.run([sys.executable, "-c", code], check=True)


class AsksForAll(Misdeed):
    """More than any machine has, in one piece."""

    def misbehave(self):
        return Control(np.ones(10**12).sum(), 0.0)


class Computes(Misdeed):
    """For ever."""

    def misbehave(self):
        while True:
            pass


class Daemonises(Misdeed):
    """A grandchild in a session of its own, whose parents are gone and whose environment is empty."""

    def misbehave(self):
        code = "import os, time\nprint(os.getpid(), flush=True)\ntime.sleep(3600)"
        fork = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {code!r}], start_new_session=True)"
        command = [sys.executable, "-c", fork]
        with subprocess.Popen(command, env={}, start_new_session=True, stdout=subprocess.PIPE) as child:
            told = child.stdout.readline()
        Path(os.environ["TSBENCH_TEST_MARK"]).with_suffix(".daemon").write_bytes(told)
        return Control(0.0, 0.0)


MISDEEDS = [
    OwnNumber,
    lambda: Raised(lambda: Own("mine")),
    lambda: Raised(lambda: KeyboardInterrupt("stop")),
    lambda: Raised(lambda: GeneratorExit("gone")),
    lambda: Raised(lambda: ValueError("half a character: \ud800")),
    lambda: Raised(Mute),
    lambda: Raised(lambda: ValueError("word " * 2_000_000)),
    *(ClosesAll, TakesLine, WritesLine, Gorges, ChildGorges, AsksForAll, Computes, Daemonises),
]


class Hostile(Good):
    """One misdeed after the other, from the scenario of seed 100 on."""

    def reset(self, context):
        super().reset(context)
        number = context.seed - 100
        self.misdeed = MISDEEDS[number] if number < len(MISDEEDS) else None
        if number == len(MISDEEDS):
            raise SystemExit("reset")

    def act(self, observation):
        misdeed, self.misdeed = self.misdeed, None
        return misdeed().misbehave() if misdeed else super().act(observation)


class Spoils(Good):
    """Changes its whole process: how numbers are rounded, what an error of NumPy does, what others call."""

    def reset(self, context):
        super().reset(context)
        ctypes.CDLL("libm.so.6").fesetround(0x800)
        np.seterr(all="raise")
        os.environ["TSBENCH_DATA"] = "/nowhere"
        sys.modules["fake_runner"].advance = lambda motion, *command: motion


class Thirds(Good):
    """Its poses depend on how numbers are rounded."""

    def act(self, observation):
        return Control(1.0 / 3.0, 0.001 / 3.0)


class Leaks(Good):
    """Takes 40 MB more in every episode."""

    # Its episodes share a process, which grows.
    keeps_process = True

    kept: ClassVar[list] = []

    def reset(self, context):
        super().reset(context)
        self.kept.append(np.ones(5_000_000))


class Slow(Good):
    def act(self, observation):
        time.sleep(0.002)
        return super().act(observation)


def function(observation):
    return Control(0.2, 0.0)
