"""What it costs to ask a planner in a process of its own, on scenes of the dev split."""

from __future__ import annotations

import numpy as np

from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import resolve
from tsbench.run.isolation.loading import describe, load
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.table import read_table, table_path
from tsbench.sim.sumo import Simulation
from tsbench.tools.check import choose

PLANNERS = ("idm", "idm-e")


def bench_isolation(scenes: int, rounds: int) -> list[tuple[str, float, float]]:
    """Of each planner: median time of an answer by the clock, µs, in the referee's process and isolated.

    Of the best of the rounds, as others use the machine, too.
    """
    rows = choose(read_table(table_path("dev")), scenes)
    simulation, loader = Simulation(), SceneLoader()
    found = []
    for name in PLANNERS:
        runners = [
            EpisodeRunner(planner, simulation=simulation, loader=loader)
            for planner in (resolve(name), load(describe(name).planner))
        ]
        took: tuple[list[float], list[float]] = ([], [])
        for _ in range(rounds):
            for runner, kept in zip(runners, took, strict=True):
                kept.append(
                    1e6 * float(np.median(np.concatenate([runner.run(row).planner_s for row in rows])))
                )
        found.append((name, min(took[0]), min(took[1])))
    simulation.close()
    return found
