"""`tsbench train plant2-ft`: imitation of obedient driving, from `plant2`'s weights. Source: docs/spec/planners.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from tsbench.core.errors import InputError
from tsbench.learn.finetune.frames import LessonSource
from tsbench.learn.finetune.recipe import FineTuning, begins_with, lessons_of, name_of
from tsbench.learn.finetune.targets import FAMILIES
from tsbench.learn.imitation.frames_store import FrameStore
from tsbench.learn.imitation.loss import losses
from tsbench.learn.imitation.recipe import validation_rows
from tsbench.learn.imitation.skill import Skill, measure
from tsbench.learn.imitation.task import rate_at
from tsbench.learn.imitation.trainer import Integers, Place
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.network import Plant2Network
from tsbench.planners.plant2.network_ft import Plant2FtNetwork
from tsbench.planners.plant2.torch_inference import network_of
from tsbench.planners.weights import load_weights
from tsbench.scenarios.spec import ScenarioSpec

_SORTED_BATCHES = 16
# Of compliance in the score: less than an episode more or less of any validation.
_TIE = 1e-6


class FinetuneTask:
    """The task. rows: of the train split."""

    name = "plant2-ft"

    def __init__(self, recipe: FineTuning, rows: Sequence[ScenarioSpec]) -> None:
        self._recipe = recipe
        self.epochs, self.seed, self.clip = recipe.epochs, recipe.seed, recipe.clip
        self._drives = lessons_of(rows, recipe)
        self._facts = recipe.facts()
        self._validation = validation_rows(rows, recipe.validation, recipe.seed)
        if not self._drives or not self._validation:
            raise InputError("the train split has no scenarios of these types to learn from and to choose by")

    def facts(self) -> dict[str, Any]:
        """The recipe, with the hashes of what it builds on."""
        return self._facts

    def network(self) -> Plant2Network:
        """The base's weights with the new parameters as drawn, or a fine-tuned network as it stands."""
        base, (size, _) = self._recipe.base, begins_with(self._recipe.base)
        begin = network_of(size, load_weights(name_of(base), base), name_of(base))
        if isinstance(begin, Plant2FtNetwork):
            return begin
        net = Plant2FtNetwork(size)
        net.take_over(begin)
        return net

    def groups(self, net: Plant2Network) -> list[dict[str, Any]]:
        """The rate by layer, weight decay for matrices alone."""
        r = self._recipe
        found: dict[tuple[float, float], list[Any]] = {}
        for name, parameter in net.named_parameters():
            decay = 0.0 if parameter.ndim < 2 or name == "queries" else r.decay
            found.setdefault((share_of(name, net, r), decay), []).append(parameter)
        return [{"params": p, "share": share, "weight_decay": decay} for (share, decay), p in found.items()]

    def store(self, place: Place, progress: Callable[[int], None]) -> FrameStore:
        """Of obedient drives."""
        return FrameStore(
            place.out / "frames", self._drives, LessonSource(self._recipe.sampling), seed=self._recipe.seed,
            bound_bytes=place.cache_bytes, workers=place.workers, progress=progress,
        )  # fmt: skip

    def batches(self, frames: Records, order: Integers) -> list[Integers]:
        """No family beyond its share of a batch."""
        return capped_batches(frames, order, self._recipe.batch, self._recipe.cap)

    def losses(self, net: Plant2Network, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Path, waypoints, speed."""
        return losses(net(batch, forecast=False), batch)

    def rate_at(self, share: float) -> float:
        """Up in a line, down by a cosine."""
        return rate_at(share, self._recipe.rate, self._recipe.warm_up)

    def measure(self, folder: Path, workers: int) -> Skill:
        """On the maps that are kept for it."""
        return measure(self.name, folder, self._validation, workers)

    def score(self, skill: Skill) -> float:
        """SCD: a loss says little of it. Of equal SCD the more compliant one."""
        return skill.scd + _TIE * skill.compliant


def share_of(name: str, net: Plant2Network, recipe: FineTuning) -> float:
    """A parameter's part of the learning rate: 1 for heads, less by layer towards the inputs, more for what is new."""
    layers = len(net.encoder.layers)
    part, *rest = name.split(".")
    if part in ("signs", "sign_state", "ways", "speed_token", "ego_speed_head"):
        return recipe.new_factor
    if part == "encoder":
        return float(recipe.layer_decay ** (layers - int(rest[1])))
    return 1.0 if part.endswith("_head") else float(recipe.layer_decay ** (layers + 1))


def quotas(counts: Integers, size: int, cap: float) -> Integers:
    """(families,) frames of each in a batch of `size`, as there are of each, but none beyond `cap` of the batch.

    Where there are too few families for the cap, they have equal parts.
    """
    there = counts > 0
    most = max(int(cap * size), -(-size // max(int(there.sum()), 1)))
    quota = np.zeros(len(counts), dtype=np.intp)
    # One at a time to who is farthest below its share: 128 steps of six families, once a window.
    for _ in range(size):
        open_ = there & (quota < most)
        quota[int(np.argmin(np.where(open_, (quota + 0.5) / np.maximum(counts, 1), np.inf)))] += 1
    return quota


def capped_batches(frames: Records, order: Integers, size: int, cap: float) -> list[Integers]:
    """Rows in batches of `size`, families as in `quotas`; what is too much of a family is left out of this pass.

    Within groups of batches each holds frames with about as many objects: the rest of the slots is left out.
    """
    family = frames["family"]
    decks = [order[family[order] == k] for k in range(len(FAMILIES))]
    counts = np.array([len(deck) for deck in decks])
    if not counts.any():
        return []
    quota = quotas(counts, size, cap)
    asked = quota > 0
    total = int((counts[asked] // quota[asked]).min())
    objects = np.count_nonzero(frames["kinds"], axis=1)
    batches: list[Integers] = []
    for first in range(0, total, _SORTED_BATCHES):
        many = min(_SORTED_BATCHES, total - first)
        parts = []
        for deck, each in zip(decks, quota.tolist(), strict=True):
            group = deck[first * each : (first + many) * each]
            parts.append(group[np.argsort(objects[group], kind="stable")].reshape(many, each))
        rows = np.concatenate(parts, axis=1)
        # The group's own order decides which batch comes when.
        batches += list(rows[np.argsort(order[first : first + many])])
    return batches
