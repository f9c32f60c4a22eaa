"""Closed-loop skill of a network under training: what checkpoints are chosen by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

from tsbench.core.errors import SimulationError
from tsbench.core.machine import one_thread_each
from tsbench.core.parallel import worker_processes
from tsbench.episode.outcome import Outcome
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.plant2.planner_ft import Plant2Blind, Plant2Ft, StopPolicy
from tsbench.learn.plant2.plant2_planner import Plant2
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.spec import ScenarioSpec

# Whose weights can be measured, by name.
MEASURED: Mapping[str, type[Plant2]] = {kind.weights: kind for kind in (Plant2, Plant2Ft, Plant2Blind)}


class End(NamedTuple):
    """Of an episode: its outcome, whether the sign was obeyed (`EpisodeFacts.obeyed`), its error."""

    outcome: Outcome
    obeyed: bool
    error: str


@dataclass(frozen=True, slots=True)
class Skill:
    """Shares of episodes: arrived, with a contact, off the road, out of time, arrived and compliant; compliant."""

    episodes: int
    arrived: float
    collision: float
    off_road: float
    timeout: float
    scd: float
    compliant: float


def measure(planner: str, folder: Path, rows: Sequence[ScenarioSpec], workers: int) -> Skill:
    """Drive the weights of a planner of MEASURED below `folder` through `rows`; raises as `drive` and `skill_of`."""
    return skill_of(drive(planner, folder, rows, workers))


def drive(
    planner: str, folder: Path | None, rows: Sequence[ScenarioSpec], workers: int, stop_policy: StopPolicy | None = None
) -> list[End]:
    """How the episodes of `rows` end, in their order. folder: None = tsbench's own weights. patience: of `plant2-ft`,
    None = its own.
    """
    shares = [list(rows[k::workers]) for k in range(workers)]
    with one_thread_each(), worker_processes(workers, "measuring a planner") as pool:
        parts = list(pool.ordered(_drive, [(planner, folder, stop_policy, share) for share in shares]))
    return [parts[k % workers][k // workers] for k in range(len(rows))]


def skill_of(ends: Sequence[End]) -> Skill:
    """Shares of some episodes.

    Raises SimulationError where an episode ended in an error: no skill is averaged over a hole.
    """
    broken = [end.error for end in ends if end.error]
    if broken:
        raise SimulationError(f"validation: {len(broken)} episodes broke off, the first by: {broken[0]}")
    count = max(len(ends), 1)
    ways = (Outcome.ARRIVED, Outcome.COLLISION, Outcome.OFF_ROAD, Outcome.TIMEOUT)
    share = {str(way): sum(end.outcome == way for end in ends) / count for way in ways}
    scd = sum(end.outcome is Outcome.ARRIVED and end.obeyed for end in ends) / count
    return Skill(episodes=len(ends), scd=scd, compliant=sum(end.obeyed for end in ends) / count, **share)


def _drive(planner: str, folder: Path | None, stop_policy: StopPolicy | None, rows: list[ScenarioSpec]) -> list[End]:
    import torch

    torch.set_num_threads(1)
    kind = MEASURED[planner]
    make = partial(kind, stop_policy=stop_policy) if issubclass(kind, Plant2Ft) else kind
    runner = EpisodeRunner(LoadedPlanner(planner, partial(make, folder=folder)))
    ends = []
    for row in rows:
        result = runner.run(row)
        obeyed = result.facts is not None and result.facts.obeyed
        ends.append(End(result.outcome, obeyed, result.error if result.outcome.is_error else ""))
    runner.close()
    return ends
