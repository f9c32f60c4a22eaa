"""A training by imitation: which network learns what from which drives, and how it is judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.learn.imitation.frames import EpisodeDrive
from tsbench.learn.imitation.frames_store import ImitationSource, Source
from tsbench.learn.imitation.recipe import ImitationRecipe, TrainingRecipe, drives_of, validation_rows
from tsbench.learn.imitation.skill import Skill
from tsbench.learn.plant2.layout import Records
from tsbench.learn.plant2.plant2_network import Plant2Network
from tsbench.scenarios.spec import ScenarioSpec

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
