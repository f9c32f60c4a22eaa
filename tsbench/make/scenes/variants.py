"""The ten variants of a map. Source: docs/scenes.md, "Variants"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsbench.core.benchmark import VARIANTS
from tsbench.make.seeds import rng_of, seed_of
from tsbench.sim.nuplan import DENSITY_KEY, LANE_KM_WITHIN_REACH, SPEED_KEY, quantile

ROUTE_LENGTHS_M = (60.0, 120.0)
# Of the published density: from the first of its quantiles to the last.
DENSITY_SHARES = (0.05, 0.95)
LEAST_SPEED_MPS = 1.0
# The published quartiles: where a type has another scale of speeds, they are its ends.
INITIAL_SPEEDS_MPS = (3.61, 11.05)
DRIVER_DRAWS = 3
LAYOUTS = 6
DISTRACTORS = (2, 3, 1, 0)  # of ten variants three have the first number, three the second
NOMINAL_SPEED_MPS = 7.75


@dataclass(frozen=True, slots=True)
class Variant:
    """What one scene of a map asks. `number` 0 is nominal: no background traffic (density 0, drivers -1).

    route_length: m asked after the decision point, within ROUTE_LENGTHS_M. density: moving cars per lane within 150 m.
    initial_speed: m/s. drivers: number of their draw, below DRIVER_DRAWS. layout: number on the scene's own axis, taken
    modulo the choices that the map gives; so are value (of what the plate posts) and plate (of several that say the
    like). distractors: how many plates stand there that don't bind the ego.
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

    def route_end(self, least: float, room: float) -> float:
        """Where the route ends, m after the decision point.

        The ends of a map's variants spread over its room of at most the greatest asked length, from half of it up.
        least: m that the type needs. room: m that the map has, at least as much.
        """
        low, high = ROUTE_LENGTHS_M
        most = min(room, high)
        start = max(least, most / 2)
        return round(start + (most - start) * (self.route_length - low) / (high - low), 1)


def variants_of(scenario_type: str, map_id: str) -> tuple[Variant, ...]:
    """Variant 0 and nine others, drawn by a stable hash of type and map.

    Speed, density and route length are stratified: each of a map's nine variants lies in another ninth of their
    distributions. Drivers, layouts and what the plates post go round their axes from variant to variant, so that each
    number is there about as often.
    """
    rng = rng_of("variants", scenario_type, map_id)
    count = VARIANTS - 1
    speeds, densities, lengths = ((rng.permutation(count) + rng.random(count)) / count for _ in range(3))
    drivers = rng.permutation(np.arange(count) % DRIVER_DRAWS)
    layouts = rng.permutation(np.arange(count) % LAYOUTS)
    nominal = (ROUTE_LENGTHS_M[0], 0.0, NOMINAL_SPEED_MPS, -1, seed_of("layout", map_id) % LAYOUTS)
    drawn = (
        (
            round(float(np.interp(lengths[k], (0.0, 1.0), ROUTE_LENGTHS_M)), 1),
            round(quantile(DENSITY_KEY, float(np.interp(densities[k], (0.0, 1.0), DENSITY_SHARES))), 2),
            round(max(quantile(SPEED_KEY, float(speeds[k])), LEAST_SPEED_MPS), 2),
            int(drivers[k]),
            int(layouts[k]),
        )
        for k in range(count)
    )
    asked = rng_of("asked", scenario_type, map_id)
    first, plates = int(asked.integers(VARIANTS)), asked.permutation(VARIANTS)
    distractors = asked.permutation(np.arange(VARIANTS) % len(DISTRACTORS))
    return tuple(
        Variant(k, *point, value=first + k, plate=int(plates[k]), distractors=DISTRACTORS[int(distractors[k])])
        for k, point in enumerate([nominal, *drawn])
    )
