"""The ten variants of a map. Source: docs/scenes.md, "Variants"."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from tsbench.core.benchmark import VARIANTS
from tsbench.dataset.seeds import rng_of, seed_of

ROUTE_LENGTHS_M = (90.0, 120.0)
DENSITIES = (2.3333, 4.0, 5.5)
INITIAL_SPEEDS_MPS = (3.61, 7.75, 11.05)
DRIVER_DRAWS = (0, 1, 2)
LAYOUTS = (0, 1, 2, 3, 4, 5)
DISTRACTORS = (2, 3, 1, 0)  # of ten variants three have the first number, three the second
NOMINAL_SPEED_MPS = 7.75
LANE_KM_WITHIN_REACH = 0.3


@dataclass(frozen=True, slots=True)
class Variant:
    """One point of the grid. `number` 0 is nominal: no background traffic (density 0, drivers -1).

    route_length: m asked after the decision point. density: moving cars per lane within 150 m. initial_speed: m/s.
    layout: number on the scene's own axis, taken modulo the choices that the map gives; so are value (of what the plate
    posts) and plate (of several that say the like). distractors: how many plates stand there that don't bind the ego.
    """

    number: int
    route_length: float
    density: float
    initial_speed: float
    drivers: int
    layout: int
    value: int = 0
    plate: int = 0
    distractors: int = 0

    @property
    def cars_per_lane_km(self) -> float:
        """The density per lane-kilometre: 150 m ahead and behind are 0.3 km of lane."""
        return self.density / LANE_KM_WITHIN_REACH


def variants_of(scenario_type: str, map_id: str) -> tuple[Variant, ...]:
    """Variant 0 and nine different points of the grid, by a stable hash of type and map.

    What the plates ask goes round its axis from variant to variant, so that each number is there about as often.
    """
    grid = list(product(ROUTE_LENGTHS_M, DENSITIES, INITIAL_SPEEDS_MPS, DRIVER_DRAWS, LAYOUTS))
    rng = rng_of("variants", scenario_type, map_id)
    chosen = rng.choice(len(grid), size=VARIANTS - 1, replace=False)
    nominal = (ROUTE_LENGTHS_M[0], 0.0, NOMINAL_SPEED_MPS, -1, seed_of("layout", map_id) % len(LAYOUTS))
    asked = rng_of("asked", scenario_type, map_id)
    first, plates = int(asked.integers(VARIANTS)), asked.permutation(VARIANTS)
    distractors = asked.permutation(np.arange(VARIANTS) % len(DISTRACTORS))
    return tuple(
        Variant(
            k, *point, value=first + k, plate=int(plates[k]), distractors=DISTRACTORS[int(distractors[k])]
        )
        for k, point in enumerate([nominal, *(grid[int(i)] for i in chosen)])
    )
