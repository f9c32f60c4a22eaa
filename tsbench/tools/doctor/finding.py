"""What a check of the doctor saw, and the means that several checks need."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version

TIMEOUT_S = 120
REPAIR = "make setup in a clone; else pip install --force-reinstall tsbench tsbench-data"


class Status(StrEnum):
    """How a check ended; only `FAILED` makes the exit code 1."""

    OK = "ok"
    NOTE = "note"  # something is not there that only some need
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a check saw. remedy: what to do, "" where nothing is."""

    status: Status
    name: str
    text: str
    remedy: str = ""


def installed(names: Iterable[str]) -> dict[str, str]:
    """Version by name of those that are installed."""
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def alone(code: str) -> tuple[int, str]:
    """Run code in a process of its own: (exit code, the last line that it said)."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return 1, f"no end after {TIMEOUT_S} s"
    said = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    if done.returncode < 0:
        return done.returncode, f"killed by signal {-done.returncode}"
    return done.returncode, said[-1] if said else "no words"
