"""Closed-loop skill of a network under training: what checkpoints are chosen by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import ClassVar

from tsbench.errors import SimulationError
from tsbench.metrics.outcome import Outcome
from tsbench.planners.plant2.planner import Plant2
from tsbench.planners.plant2.planner_ft import Plant2Ft
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


class Student(Plant2):
    """The planner with weights from a folder, which hangs on the class: episode runners make planners by name."""

    folder: ClassVar[Path]

    def __init__(self) -> None:
        super().__init__(folder=self.folder)


class StudentFt(Plant2Ft):
    """The same for the one that reads signs."""

    folder: ClassVar[Path]

    def __init__(self) -> None:
        super().__init__(folder=self.folder)


STUDENTS: Mapping[str, type[Student | StudentFt]] = {"plant2": Student, "plant2-ft": StudentFt}


def measure(planner: str, folder: Path, rows: Sequence[ScenarioSpec], workers: int) -> Skill:
    """Drive the weights of a planner (of STUDENTS) below `folder` through `rows`.

    Raises SimulationError where an episode ends in an error: no skill is averaged over a hole.
    """
    shares = [list(rows[k::workers]) for k in range(workers)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        ends = [
            end for part in pool.map(_drive, [planner] * workers, [folder] * workers, shares) for end in part
        ]
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


def _drive(planner: str, folder: Path, rows: list[ScenarioSpec]) -> list[tuple[Outcome, bool, str]]:
    """In a process of its own: outcome, compliance and error of each episode."""
    import torch

    torch.set_num_threads(1)
    student = STUDENTS[planner]
    student.folder = folder
    runner = EpisodeRunner(f"{__name__}:{student.__name__}", planner)
    ends = []
    for row in rows:
        result = runner.run(row)
        obeyed = result.facts is not None and result.facts.target.compliant
        ends.append((result.outcome, obeyed, result.error if result.outcome.is_error else ""))
    runner.close()
    return ends
