"""What it costs to ask a planner in a process of its own, on scenes of the dev split."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np

from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.isolation.loading import describe, load
from tsbench.run.isolation.sandbox_paths import EXECUTABLE
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.table import read_table, table_path
from tsbench.sim.sumo import Simulation
from tsbench.tools.check import choose

PLANNERS: Final = ("idm", "idm-e")
GOAL_US: Final = 150.0


@dataclass(frozen=True)
class Price:
    """Median times of a planner's answer by the clock, µs: of the best of the rounds, as others use the machine, too.

    together: in the referee's process; None for a program. isolated: on the referee's processor, as where workers use
    all of them. apart: on any processor, which may have to be woken up for each answer.
    """

    planner: str
    together_us: float | None
    isolated_us: float
    apart_us: float

    @property
    def difference_us(self) -> float | None:
        return None if self.together_us is None else self.isolated_us - self.together_us


def bench_isolation(planners: Sequence[str], scenes: int, rounds: int) -> list[Price]:
    """Raises InputError for a planner that does not come up."""
    rows = choose(read_table(table_path("dev")), scenes)
    loader = SceneLoader()
    with closing(Simulation()) as simulation:

        def took(runner: EpisodeRunner) -> float:
            return 1e6 * float(np.median(np.concatenate([runner.run(row).planner_s for row in rows])))

        def runner_of(planner: LoadedPlanner) -> EpisodeRunner:
            return EpisodeRunner(planner, simulation=simulation, loader=loader)

        found = []
        for name in planners:
            here = None if name.startswith(EXECUTABLE) else runner_of(resolve(name))
            info = describe(name).planner
            beside, free = runner_of(load(info, show=True)), runner_of(load(info, show=True))
            together, isolated, apart = [], [], []
            for _ in range(rounds):
                if here is not None:
                    together.append(took(here))
                # Where the planner's process is started is where it stays.
                with _one_processor():
                    isolated.append(took(beside))
                apart.append(took(free))
            found.append(Price(info.name, min(together, default=None), min(isolated), min(apart)))
    return found


@contextmanager
def _one_processor() -> Iterator[None]:
    """This process, and what it starts, on the first of its processors."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
