"""What a training of `plant2` is asked to be."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from tsbench.core.seeds import rng_of, seed_of
from tsbench.learn.imitation.drives import PlannerDrive
from tsbench.learn.imitation.frames import Sampling
from tsbench.scenarios.spec import ScenarioSpec

# Of the train maps, one in so many is kept for the choice of checkpoints.
_VALIDATION_SHARE = 12
# Drives of a type that is asked for more of, in each turn.
_MORE = 3


@dataclass(frozen=True, slots=True)
class Recipe:
    """Figures of a training. episodes: drives to learn from, in turn over types and drivers; epochs: passes over them.

    batch, rate, decay, clip, warm_up: AdamW's batch size, top learning rate (falls by a cosine), weight decay, greatest
    norm of a gradient, share of the training in which the rate rises. validation: episodes driven after each epoch.
    """

    size: str = "mini"
    episodes: int = 4000
    epochs: int = 12
    drivers: tuple[str, ...] = ("idm",)
    types: tuple[str, ...] = ()
    batch: int = 256
    rate: float = 6e-4
    decay: float = 0.05
    clip: float = 1.0
    warm_up: float = 0.02
    validation: int = 160
    seed: int = 0
    sampling: Sampling = field(default_factory=Sampling)

    def facts(self) -> dict[str, Any]:
        """What a training that is continued must have in common with the one before."""
        found = asdict(self)
        found["drivers"], found["types"] = list(self.drivers), list(self.types)
        return {**found, "split": "train"}


def kept_for_validation(spec: ScenarioSpec) -> bool:
    """Is the row's map one of those that checkpoints are chosen on?"""
    return seed_of("imitation", "validation", spec.map_id) % _VALIDATION_SHARE == 0


def drives_of(rows: Sequence[ScenarioSpec], recipe: Recipe) -> list[PlannerDrive]:
    """The drives to learn from: types in turn, drawn rows of each, drivers in turn."""
    chosen = in_turn([r for r in rows if not kept_for_validation(r)], recipe.episodes, recipe.seed, "drives")
    return [PlannerDrive(spec, recipe.drivers[k % len(recipe.drivers)]) for k, spec in enumerate(chosen)]


def validation_rows(rows: Sequence[ScenarioSpec], count: int, seed: int) -> list[ScenarioSpec]:
    """The episodes that checkpoints are chosen on."""
    return in_turn([r for r in rows if kept_for_validation(r)], count, seed, "validation")


def in_turn(
    rows: Sequence[ScenarioSpec], count: int, seed: int, what: str, more: Collection[str] = ()
) -> list[ScenarioSpec]:
    """`count` rows: one drawn of each type (of those in `more`: three), again until there are enough or no more."""
    by_type: dict[str, list[ScenarioSpec]] = {}
    for row in sorted(rows, key=lambda r: r.scenario_id):
        by_type.setdefault(row.scenario_type, []).append(row)
    decks = []
    for name, deck in sorted(by_type.items()):
        order = rng_of("imitation", what, seed, name).permutation(len(deck))
        decks.append(([deck[i] for i in order], _MORE if name in more else 1))
    longest = max((len(deck) for deck, _ in decks), default=0)
    turns = [row for k in range(longest) for deck, each in decks for row in deck[k * each : (k + 1) * each]]
    return turns[:count]
