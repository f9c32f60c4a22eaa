"""Drivers that know at the second half of a pair that they have met the first, each by another kind of memory.

A half that is met first is driven at 0.2 m/s2, one that is met second at 0.4: no plate is read.
"""

from __future__ import annotations

import hashlib
import mmap
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from tsbench import Control, Observation, PlannerContext, pursue_route

_MET: set[int] = set()
# Says "met" to whoever connects, for as long as it lives.
_SERVER = r"""
import socket, sys
line = socket.socket(socket.AF_UNIX)
line.bind("\0" + sys.argv[1])
line.listen(9)
while True:
    line.accept()
"""


class _Driver:
    """met: was the other half driven before?"""

    met = False

    def reset(self, context: PlannerContext) -> None:
        self.met = self.remember(context.seed)

    def remember(self, seed: int) -> bool:
        raise NotImplementedError

    def act(self, observation: Observation) -> Control:
        return Control(0.4 if self.met else 0.2, 0.0)


class InObject(_Driver):
    def __init__(self) -> None:
        self.seeds: set[int] = set()

    def remember(self, seed: int) -> bool:
        met = seed in self.seeds
        self.seeds.add(seed)
        return met


class InClass(InObject):
    all_seeds: set[int] = set()  # noqa: RUF012

    def __init__(self) -> None:
        self.seeds = self.all_seeds


class InModule(InObject):
    def __init__(self) -> None:
        self.seeds = _MET


class InFile(_Driver):
    def remember(self, seed: int) -> bool:
        path = Path(os.environ.get("TMPDIR", "/tmp")) / f"{Path(__file__).stem}-{seed}"
        met = path.exists()
        path.touch()
        return met


class InProcess(_Driver):
    def remember(self, seed: int) -> bool:
        name = hashlib.sha256(f"{__file__} {seed}".encode()).hexdigest()
        if self._answers(name):
            return True
        subprocess.Popen([sys.executable, "-I", "-S", "-c", _SERVER, name], start_new_session=True)
        while not self._answers(name):
            time.sleep(0.01)
        return False

    def _answers(self, name: str) -> bool:
        with socket.socket(socket.AF_UNIX) as line:
            return line.connect_ex(f"\0{name}") == 0


class InSharedMemory(_Driver):
    """Made by the constructor, so that all children have it: no fork can wipe it."""

    def __init__(self) -> None:
        self.seeds = mmap.mmap(-1, 4096)

    def remember(self, seed: int) -> bool:
        place = seed % 4096
        met = bool(self.seeds[place])
        self.seeds[place] = 1
        return met


class Keeps(InObject):
    keeps_process = True


class Steady:
    inputs = np.dtype([("speed", np.float32)])
    served_on = ("cuda",)

    def __init__(self, infer=None) -> None:
        self._infer = infer or self.network("cpu")

    @staticmethod
    def network(device: str):
        with Path(os.environ["DEVICES_LOG"]).open("a") as log:
            log.write(f"{device}\n")
        if device == os.environ.get("NO_DEVICE"):
            raise RuntimeError("no such device")
        return lambda records: 8.0 - records["speed"].astype(float)

    def reset(self, context: PlannerContext) -> None:
        pass

    def act(self, o: Observation) -> Control:
        return Control(float(self._infer(np.array([(o.ego.speed,)], self.inputs))[0]), pursue_route(o))
