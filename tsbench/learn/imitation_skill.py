"""Closed-loop skill of a network under training: what checkpoints are chosen by."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from tsbench.errors import SimulationError
from tsbench.metrics.outcome import Outcome
from tsbench.planners.plant2.planner import Plant2
from tsbench.run.episode import EpisodeRunner
from tsbench.scenarios.spec import ScenarioSpec


@dataclass(frozen=True, slots=True)
class Skill:
    """Shares of episodes: arrived, with a contact, off the road, out of time, arrived and compliant."""

    episodes: int
    arrived: float
    collision: float
    off_road: float
    timeout: float
    scd: float

    @property
    def score(self) -> float:
        """What the best checkpoint has most of: arrivals without contacts."""
        return self.arrived - self.collision


class Student(Plant2):
    """The planner with weights from a folder, which hangs on the class: episode runners make planners by name."""

    folder: Path

    def __init__(self) -> None:
        super().__init__(folder=self.folder)


def measure(folder: Path, rows: Sequence[ScenarioSpec], workers: int) -> Skill:
    """Drive the weights below `folder` through `rows`.

    Raises SimulationError where an episode ends in an error: no skill is averaged over a hole.
    """
    shares = [list(rows[k::workers]) for k in range(workers)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        ends = [end for part in pool.map(_drive, [folder] * workers, shares) for end in part]
    broken = [error for _, _, error in ends if error]
    if broken:
        raise SimulationError(f"validation: {len(broken)} episodes broke off, the first by: {broken[0]}")
    count = max(len(ends), 1)
    share = {kind: sum(end == kind for end, _, _ in ends) / count for kind in Outcome}
    return Skill(
        episodes=len(ends), arrived=share[Outcome.ARRIVED], collision=share[Outcome.COLLISION],
        off_road=share[Outcome.OFF_ROAD], timeout=share[Outcome.TIMEOUT],
        scd=sum(end is Outcome.ARRIVED and obeyed for end, obeyed, _ in ends) / count,
    )  # fmt: skip


def _drive(folder: Path, rows: list[ScenarioSpec]) -> list[tuple[Outcome, bool, str]]:
    """In a process of its own: outcome, compliance and error of each episode."""
    import torch

    torch.set_num_threads(1)
    Student.folder = folder
    runner = EpisodeRunner(f"{__name__}:Student", "plant2")
    ends = []
    for row in rows:
        result = runner.run(row)
        obeyed = result.facts is not None and result.facts.target.compliant
        ends.append((result.outcome, obeyed, result.error if result.outcome.is_error else ""))
    runner.close()
    return ends
