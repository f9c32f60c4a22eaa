"""In what a type's rows differ: distinct values on each axis, and how many rows of a map ask something of their own."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import mean

from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import SIGNED, ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR
from tsbench.sim.scene import SceneLayout

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class TypeAxes:
    """Signed rows of a type in one split.

    plates, speeds, densities: distinct values in the type: of the plate with what it posts, initial speeds, densities.
    distractors, lanes, destinations, approaches, lengths: distinct values on a map, mean over maps: sets of plates that
    do not bind, lanes in which the ego starts, edges where it is to arrive, edges of the plate, asked lengths of route.
    apart: share of rows that differ from every other row of their map in plate, value, distractors, start lane or
    destination. apart_bare: likewise without distractors.
    """

    type_id: str
    split: str
    plates: int
    speeds: int
    densities: int
    distractors: float
    lanes: float
    destinations: float
    approaches: float
    lengths: float
    apart: float
    apart_bare: float


@dataclass(frozen=True)
class Asked:
    """What one row asks: the plate and its value, other plates, where the ego starts, and where it is to arrive."""

    plate: tuple[str, float | None]
    approach: str
    distractors: tuple[tuple[str, float | None, str], ...]
    lane: str
    destination: str

    @property
    def bare(self) -> tuple[object, ...]:
        return (self.plate, self.approach, self.lane, self.destination)


def asked_of(layout: SceneLayout) -> Asked:
    target = next(sign for sign in layout.signs if sign.id == layout.target)
    others = sorted((sign.code, sign.value, sign.edge) for sign in layout.signs if sign.role == DISTRACTOR)
    return Asked((target.code, target.value), target.edge, tuple(others), layout.start.lane, layout.destination.edge)


def type_axes(specs: Sequence[ScenarioSpec], progress: Progress) -> list[TypeAxes]:
    """One entry per type and split, in alphabetical order. Reads each signed row's scene. Raises InputError."""
    loader = SceneLoader(DataSet.in_use())
    # Rows of a map one after the other: the store unpacks a map at a time.
    signed = sorted((s for s in specs if s.half == SIGNED), key=lambda s: (s.split, s.pair_type, s.map_id, s.variant))
    groups: dict[tuple[str, str], list[tuple[ScenarioSpec, Asked]]] = defaultdict(list)
    for number, spec in enumerate(signed):
        progress(number + 1, len(signed))
        asked = asked_of(loader.layout(spec)[1])
        groups[(spec.pair_type, spec.split)].append((spec, asked))
    return [axes_of(*key, rows) for key, rows in sorted(groups.items())]


def axes_of(type_id: str, split: str, rows: Sequence[tuple[ScenarioSpec, Asked]]) -> TypeAxes:
    maps: dict[str, list[tuple[ScenarioSpec, Asked]]] = defaultdict(list)
    for spec, asked in rows:
        maps[spec.map_id].append((spec, asked))

    def on_a_map(value: Callable[[ScenarioSpec, Asked], object]) -> float:
        return mean(len({value(*row) for row in of}) for of in maps.values())

    def apart(value: Callable[[Asked], object]) -> float:
        alone = 0
        for of in maps.values():
            tally = Counter(value(asked) for _, asked in of)
            alone += sum(count == 1 for count in tally.values())
        return alone / len(rows)

    return TypeAxes(
        type_id,
        split,
        plates=len({asked.plate for _, asked in rows}),
        speeds=len({spec.initial_speed for spec, _ in rows}),
        densities=len({spec.density for spec, _ in rows}),
        distractors=on_a_map(lambda _, asked: asked.distractors),
        lanes=on_a_map(lambda _, asked: asked.lane),
        destinations=on_a_map(lambda _, asked: asked.destination),
        approaches=on_a_map(lambda _, asked: asked.approach),
        lengths=on_a_map(lambda spec, _: spec.route_length),
        apart=apart(lambda asked: asked),
        apart_bare=apart(lambda asked: asked.bare),
    )
