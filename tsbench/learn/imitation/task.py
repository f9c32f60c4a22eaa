"""`tsbench train plant2`: imitation of sign-blind driving on the train split."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from tsbench.core.errors import InputError
from tsbench.learn.imitation.frames_store import FrameStore, ImitationSource
from tsbench.learn.imitation.loss import losses
from tsbench.learn.imitation.recipe import Recipe, drives_of, validation_rows
from tsbench.learn.imitation.skill import Skill, measure
from tsbench.learn.imitation.trainer import Integers, Place
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.network import Plant2Network
from tsbench.scenarios.spec import ScenarioSpec

_SORTED_BATCHES = 16


class Imitation:
    """The task. rows: of the train split."""

    name = "plant2"

    def __init__(self, recipe: Recipe, rows: Sequence[ScenarioSpec]) -> None:
        self._recipe = recipe
        self.epochs, self.seed, self.clip = recipe.epochs, recipe.seed, recipe.clip
        self._drives = drives_of(rows, recipe)
        self._validation = validation_rows(rows, recipe.validation, recipe.seed)
        if not self._drives or not self._validation:
            raise InputError("the train split has no scenarios of these types to learn from and to choose by")

    def facts(self) -> dict[str, Any]:
        """The recipe."""
        return self._recipe.facts()

    def network(self) -> Plant2Network:
        """Nothing learned yet."""
        return Plant2Network(self._recipe.size)

    def groups(self, net: Plant2Network) -> list[dict[str, Any]]:
        """Weight decay for matrices, none for biases, norms and queries."""
        named = list(net.named_parameters())
        free = [p for name, p in named if p.ndim < 2 or name == "queries"]
        bound = [p for name, p in named if not (p.ndim < 2 or name == "queries")]
        return [
            {"params": bound, "weight_decay": self._recipe.decay},
            {"params": free, "weight_decay": 0.0},
        ]

    def store(self, place: Place, progress: Callable[[int], None]) -> FrameStore:
        """Of the drives of the recipe's drivers."""
        recipe = self._recipe
        return FrameStore(
            place.out / "frames", self._drives, ImitationSource(recipe.sampling), seed=recipe.seed,
            bound_bytes=place.cache_bytes, workers=place.workers, progress=progress,
        )  # fmt: skip

    def batches(self, frames: Records, order: Integers) -> list[Integers]:
        """Every frame once."""
        return batches_of(frames, order, self._recipe.batch)

    def losses(self, net: Plant2Network, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """All terms."""
        return losses(net(batch), batch)

    def rate_at(self, share: float) -> float:
        """Up in a line, down by a cosine."""
        return rate_at(share, self._recipe.rate, self._recipe.warm_up)

    def measure(self, folder: Path, workers: int) -> Skill:
        """On the maps that are kept for it."""
        return measure("plant2", folder, self._validation, workers)

    def score(self, skill: Skill) -> float:
        """Arrivals without contacts."""
        return skill.arrived - skill.collision


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


def rate_at(share: float, top: float, warm_up: float) -> float:
    """The learning rate when `share` of the training is done: up in a line, down by a cosine."""
    if share < warm_up:
        return top * (0.01 + 0.99 * share / warm_up)
    return 0.5 * top * (1.0 + math.cos(math.pi * (share - warm_up) / (1.0 - warm_up)))
