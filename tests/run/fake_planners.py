"""Planners that do what planners must not do. Each misbehaves in the scenario of seed 107 only."""

from __future__ import annotations

import os
import signal
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


class Raises(Bad):
    def misbehave(self):
        raise RuntimeError(f"no idea what to do with {object()}")


class ReturnsNone(Bad):
    def misbehave(self):
        return None


class Nan(Bad):
    def misbehave(self):
        return Control(float("nan"), 0.0)


class Inf(Bad):
    def misbehave(self):
        return Control(0.0, float("inf"))


class WrongShape(Bad):
    def misbehave(self):
        return Trajectory(np.arange(1.0, 4.0), np.zeros((2, 3)))


class Prints(Bad):
    def misbehave(self):
        print("x" * 100_000)
        os.write(2, b"y" * 100_000)
        return Control(0.0, 0.0)


class PrintsAndRaises(Bad):
    def misbehave(self):
        print("noise " * 100_000, "last words")
        raise ValueError("enough")


class Sleeps(Bad):
    def misbehave(self):
        time.sleep(3600)


class Exits(Bad):
    def misbehave(self):
        os._exit(7)


class SysExits(Bad):
    def misbehave(self):
        sys.exit("bye")


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


class Leaks(Good):
    """Takes 40 MB more in every episode."""

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
