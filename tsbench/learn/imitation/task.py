"""A training by imitation: which network learns what from which drives, and how it is judged.

Its skill in closed loop is what checkpoints are chosen by.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError, SimulationError
from tsbench.core.machine import one_thread_each
from tsbench.core.parallel import worker_processes
from tsbench.episode.outcome import Outcome
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.imitation.frames import EpisodeDrive
from tsbench.learn.imitation.frames_store import ImitationSource, Source
from tsbench.learn.imitation.recipe import ImitationRecipe, TrainingRecipe, drives_of, validation_rows
from tsbench.learn.plant2.layout import Records
from tsbench.learn.plant2.planner_ft import Plant2Blind, Plant2Ft, StopPolicy
from tsbench.learn.plant2.plant2_network import Plant2Network
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


Integers = npt.NDArray[np.intp]

_SORTED_BATCHES = 16


@dataclass(frozen=True)
class ImitationTask:
    """What is learned. Raises InputError where there is nothing to learn from or to choose by.

    Attributes
    ----------
        name: of the network, as it is exported.
        source: makes frames of `drives`.
        validation: rows that checkpoints are chosen by.
        network: makes the network to begin with.
        batches: rows of frames, which are given with all of them in a drawn order, in batches.
        score: what the best checkpoint has most of; not below -1.
        share: of the learning rate, by a parameter's name.
        metadata: of the exported file's head.
    """

    name: str
    recipe: TrainingRecipe
    drives: Sequence[EpisodeDrive]
    source: Source
    validation: Sequence[ScenarioSpec]
    network: Callable[[], Plant2Network]
    batches: Callable[[Records, Integers], list[Integers]]
    score: Callable[[Skill], float]
    share: Callable[[str], float] = lambda _: 1.0
    metadata: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        if not self.drives or not self.validation:
            raise InputError("the train split has no scenarios of these types to learn from and to choose by")


def imitation(recipe: ImitationRecipe, rows: Sequence[ScenarioSpec]) -> ImitationTask:
    """`plant2`: sign-blind driving, from nothing. rows: of the train split."""
    return ImitationTask(
        "plant2",
        recipe,
        drives_of(rows, recipe),
        ImitationSource(recipe.sampling),
        validation_rows(rows, recipe.validation, recipe.seed),
        network=lambda: Plant2Network(recipe.size),
        batches=lambda frames, order: batches_of(frames, order, recipe.batch),
        score=lambda skill: skill.arrived - skill.collision,
    )


def batches_of(frames: Records, order: Integers, size: int) -> list[Integers]:
    """Rows of `frames` in batches, each of frames with about as many objects: the rest of the slots is left out."""
    groups = [order[k : k + _SORTED_BATCHES * size] for k in range(0, len(order), _SORTED_BATCHES * size)]
    batches: list[Integers] = []
    for group in groups:
        counts = np.count_nonzero(frames["kinds"][group], axis=1)
        ranked = group[np.argsort(counts, kind="stable")]
        # The group's own order decides which batch comes when.
        starts = np.argsort(group[: len(group) // size * size : size])
        batches += [ranked[k * size : (k + 1) * size] for k in starts]
    return batches
