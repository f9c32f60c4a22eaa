"""Findings about a planner that need no driving, in plain words. `tsbench.run.check_planner` checks its driving."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum

from tsbench.planners.base import Planner
from tsbench.planners.registry import FunctionPlanner, LoadedPlanner

_SLOW_START_S = 20.0


class Level(StrEnum):
    """How much a finding weighs: a problem spoils results, a note is worth knowing."""

    OK = "ok"
    NOTE = "note"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing seen: what was looked at, and a sentence."""

    level: Level
    topic: str
    text: str


def check_statically(loaded: LoadedPlanner) -> list[Finding]:
    """Contract, shared state and start-up of a planner that has been resolved."""
    start = time.perf_counter()
    try:
        planner = loaded.factory()
    except Exception as error:
        return [Finding(Level.PROBLEM, "start", f"cannot be made: {type(error).__name__}: {error}")]
    seconds = time.perf_counter() - start
    level = Level.NOTE if seconds > _SLOW_START_S else Level.OK
    kind = "a function" if isinstance(planner, FunctionPlanner) else "a class with reset and act"
    found = [
        Finding(level, "start", f"made in {seconds:.2f} s; every worker of a run makes its own"),
        Finding(Level.OK, "contract", f"is {kind}"),
    ]
    if loaded.privileged:
        text = "asks for the target rule (privileged = True): its results are flagged as an expert's"
        found.append(Finding(Level.NOTE, "privilege", text))
    return found + _shared_state(planner)


def _shared_state(planner: Planner) -> list[Finding]:
    """Lists, dicts and sets on the class outlive an episode and are shared by all instances."""
    owner = type(planner)
    shared = sorted(
        name for name, value in vars(owner).items() if isinstance(value, list | dict | set) and name[:2] != "__"
    )
    return [
        Finding(
            Level.NOTE,
            "state",
            f"{owner.__name__}.{name} is a {type(vars(owner)[name]).__name__} on the class: what is put into it "
            "outlives the episode; make it in reset",
        )
        for name in shared
    ]
