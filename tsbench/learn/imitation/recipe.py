"""What a training by imitation is asked to be, and the rows that it learns from and is chosen by."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from tsbench.core.seeds import rng_of, seed_of
from tsbench.learn.imitation.frames import PlannerDrive, Sampling
from tsbench.scenarios.spec import ScenarioSpec

# Of the train maps, one in so many is kept for the choice of checkpoints.
_VALIDATION_SHARE = 12
# Drives of a type that is asked for more of, in each turn.
_MORE = 3


@dataclass(frozen=True, kw_only=True)
class TrainingRecipe:
    """Figures of every training by imitation.

    epochs: passes over the frames. batch, rate, decay, clip, warm_up: AdamW's batch size, top learning rate (falls by a
    cosine), weight decay, greatest norm of a gradient, share of the training in which the rate rises. validation:
    episodes driven after each epoch. drivers: planners that are driven for frames, in turn. types: () = all.
    """

    epochs: int
    batch: int
    rate: float
    validation: int
    drivers: tuple[str, ...] = ()
    decay: float = 0.05
    clip: float = 1.0
    warm_up: float = 0.02
    types: tuple[str, ...] = ()
    seed: int = 0
    sampling: Sampling = field(default_factory=Sampling)

    def facts(self) -> dict[str, Any]:
        """What a training that is continued must have in common with the one before, for JSON."""
        found = {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}
        return {**found, "split": "train"}


@dataclass(frozen=True, kw_only=True)
class ImitationRecipe(TrainingRecipe):
    """`plant2`'s. size: a name of `sizes.SIZES`; episodes: drives to learn from, in turn over types and drivers."""

    size: str = "mini"
    episodes: int = 4000
    epochs: int = 12
    drivers: tuple[str, ...] = ("idm",)
    batch: int = 256
    rate: float = 6e-4
    validation: int = 160


def kept_for_validation(spec: ScenarioSpec) -> bool:
    """Is the row's map one of those that checkpoints are chosen on?"""
    return seed_of("imitation", "validation", spec.map_id) % _VALIDATION_SHARE == 0


def drives_of(rows: Sequence[ScenarioSpec], recipe: ImitationRecipe) -> list[PlannerDrive]:
    """The drives to learn from: types in turn, drawn pairs of each, drivers in turn."""
    chosen = in_turn([r for r in rows if not kept_for_validation(r)], recipe.episodes, recipe.seed, "drives")
    return driven_in_turn(chosen, recipe.drivers)


def driven_in_turn(rows: Sequence[ScenarioSpec], drivers: Sequence[str]) -> list[PlannerDrive]:
    """Drivers in turn over the pairs: the driver must not tell one half from the other."""
    turn = {name: k for k, name in enumerate(dict.fromkeys(row.pair_name for row in rows))}
    return [PlannerDrive(row, drivers[turn[row.pair_name] % len(drivers)]) for row in rows]


def validation_rows(rows: Sequence[ScenarioSpec], count: int, seed: int) -> list[ScenarioSpec]:
    return in_turn([r for r in rows if kept_for_validation(r)], count, seed, "validation")


def in_turn(
    rows: Sequence[ScenarioSpec], count: int, seed: int, what: str, more: Collection[str] = ()
) -> list[ScenarioSpec]:
    """`count` rows: a pair drawn of each type (of those in `more`: three), again until there are enough or no more.

    Both halves follow each other and count as of the signed one's type, whatever the other's plate is; only the last
    pair may be cut. A row that has no other half stands for itself.
    """
    by_type: dict[str, dict[str, list[ScenarioSpec]]] = {}
    for row in sorted(rows, key=lambda r: r.scenario_id):
        by_type.setdefault(row.pair_type, {}).setdefault(row.pair_name, []).append(row)
    shuffled: list[tuple[list[list[ScenarioSpec]], int]] = []
    for name, pairs in sorted(by_type.items()):
        of_type = list(pairs.values())
        order = rng_of("imitation", what, seed, name).permutation(len(of_type))
        shuffled.append(([of_type[i] for i in order], _MORE if name in more else 1))
    longest = max((len(of_type) for of_type, _ in shuffled), default=0)
    turns = [
        row
        for k in range(longest)
        for of_type, each in shuffled
        for pair in of_type[k * each : (k + 1) * each]
        for row in pair
    ]
    return turns[:count]
