"""What it costs that an episode begins afresh: played by a child of its worker, and by the worker itself."""

from __future__ import annotations

import os
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import resolve
from tsbench.run.execution.fresh_episode import run_in_child
from tsbench.scenarios.table import read_table, table_path
from tsbench.tools.check import choose

GOAL_MS: Final = 15.0
_PLANNER = "blind"


@dataclass(frozen=True)
class FreshPrice:
    """Processor time of an episode, ms: medians over rounds of the mean over scenes. together: played by the worker."""

    together_ms: float
    in_child_ms: float

    @property
    def difference_ms(self) -> float:
        return self.in_child_ms - self.together_ms


def bench_fresh(scenes: int, rounds: int) -> FreshPrice:
    """Drive scenes of dev both ways. Children come first: a worker that forks has played nothing itself."""
    rows = sorted(choose(read_table(table_path("dev")), scenes), key=lambda row: row.net)
    runner = EpisodeRunner(resolve(_PLANNER))
    for row in rows:
        runner.prepare(row)

    def in_children() -> None:
        for row in rows:
            status = run_in_child(partial(runner.run, row))
            if status is not None:
                raise RuntimeError(f"{row.scenario_id}: the child ended with {status}")

    def together() -> None:
        for row in rows:
            runner.run(row)

    try:
        found = [
            statistics.median(1000.0 * _processor_s(play) / len(rows) for _ in range(rounds))
            for play in (in_children, together)
        ]
    finally:
        runner.close()
    return FreshPrice(together_ms=found[1], in_child_ms=found[0])


def _processor_s(work: Callable[[], None]) -> float:
    """Processor time of this process and of the children that it waits for."""
    before = os.times()
    work()
    return sum(os.times()[:4]) - sum(before[:4])
