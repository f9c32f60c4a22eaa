"""A training by imitation: which network learns what from which drives, and how it is judged.

Of `plant2` from nothing, and of `plant2-ft` from `plant2`'s weights. Source: docs/finetuning.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.learn.imitation.frames_store import ImitationSource, Source
from tsbench.learn.imitation.recipe import (
    FineTuning,
    ImitationRecipe,
    Skill,
    TrainingRecipe,
    drives_of,
    finetune_drives,
    validation_rows,
)
from tsbench.learn.imitation.targets import FAMILIES, EpisodeDrive
from tsbench.learn.plant2.plant2_network import Plant2FtNetwork, Plant2Network, network_of
from tsbench.learn.plant2.sign_tokens import Vocabulary
from tsbench.learn.plant2.tokens import SIZES, Records, size_of
from tsbench.planners.weights import fitted
from tsbench.scenarios.spec import ScenarioSpec

Integers = npt.NDArray[np.intp]

_SORTED_BATCHES = 16
# Of compliance in the score: less than an episode more or less of any validation.
_TIE = 1e-6


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


def fine_tuning(recipe: FineTuning, rows: Sequence[ScenarioSpec]) -> ImitationTask:
    """The task. rows: of the train split."""
    source = recipe.source()
    layers = SIZES[size_of(recipe.begins_with())].layers
    return ImitationTask(
        recipe.name,
        recipe,
        finetune_drives(rows, recipe),
        source,
        validation_rows(rows, recipe.validation, recipe.seed),
        network=lambda: beginning(recipe, source.vocabulary),
        batches=lambda frames, order: capped_batches(frames, order, recipe.batch, recipe.cap),
        # A loss says little of SCD. Of equal SCD the more compliant one.
        score=lambda skill: skill.scd + _TIE * skill.compliant,
        share=lambda name: share_of(name, layers, recipe),
        metadata=source.vocabulary.metadata(),
    )


def beginning(recipe: FineTuning, words: Vocabulary) -> Plant2Network:
    """The base's weights with the new parameters as drawn, or a fine-tuned network as it stands."""
    base = recipe.begins_with()
    size = size_of(base)
    begin = fitted(base.name, recipe.base, lambda weights: network_of(size, weights))
    if isinstance(begin, Plant2FtNetwork):
        return begin
    net = Plant2FtNetwork(size, len(words.codes))
    net.take_over(begin)
    return net


def share_of(name: str, layers: int, recipe: FineTuning) -> float:
    """A parameter's part of the learning rate: 1 for heads, less by layer towards the inputs, more for what is new."""
    part, *rest = name.split(".")
    if part in ("signs", "held", "ways", "speed_token", "ego_speed_head"):
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
    shuffled = [order[family[order] == k] for k in range(len(FAMILIES))]
    counts = np.array([len(drawn) for drawn in shuffled])
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
        for drawn, each in zip(shuffled, quota.tolist(), strict=True):
            group = drawn[first * each : (first + many) * each]
            parts.append(group[np.argsort(objects[group], kind="stable")].reshape(many, each))
        rows = np.concatenate(parts, axis=1)
        # The group's own order decides which batch comes when.
        batches += list(rows[np.argsort(order[first : first + many])])
    return batches
