"""Background drivers drawn from the nuPlan figures. Source: docs/simulation.md, "Traffic"."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsbench.sim.nuplan import quantile_speed, statistics

DRIVERS_PER_DRAW = 12
# Bodies by nuPlan's size classes: length, width in m.
BODIES = {"s": (3.7, 1.65), "m": (4.5, 1.85), "l": (5.3, 2.0), "xl": (8.5, 2.4)}


@dataclass(frozen=True, slots=True)
class Driver:
    """One IDM driver: desired speed (m/s), a, b (m/s2), headway (s), standstill gap (m), body length and width (m)."""

    speed: float
    accel: float
    decel: float
    headway: float
    gap: float
    length: float
    width: float


def _lognormal(rng: np.random.Generator, median: float, mean: float, low: float, high: float) -> float:
    sigma = math.sqrt(2.0 * math.log(mean / median))
    return float(np.clip(median * math.exp(sigma * rng.standard_normal()), low, high))


def draw_driver(rng: np.random.Generator) -> Driver:
    """One driver.

    Free-flow speed: the upper three fifths of moving speeds, because the lower ones are cars held up by others.
    IDM's a and b are *largest* comfortable values: twice the published typical ones. The headway is what the published
    median gap is at the published median speed.
    """
    stats = statistics()
    acc, dec = stats["acceleration_mps2"], stats["deceleration_mps2"]
    following = stats["following_distance_m"]
    gap = float(rng.uniform(1.5, 3.0))
    headway = (float(following["p50"]) - gap) / float(stats["speed_mps"]["p50"])
    spread = float(following["mean"]) / float(following["p50"])
    sizes = stats["size_mix"]
    size = str(rng.choice(list(sizes), p=np.array(list(sizes.values())) / sum(sizes.values())))
    length, width = BODIES[size]
    return Driver(
        speed=quantile_speed(float(rng.uniform(0.4, 1.0))),
        accel=_lognormal(rng, 2 * float(acc["p50"]), 2 * float(acc["mean"]), 0.8, 2.8),
        decel=_lognormal(rng, 2 * float(dec["p50"]), 2 * float(dec["mean"]), 1.0, 3.5),
        headway=_lognormal(rng, headway, headway * spread, 0.8, 3.0),
        gap=gap,
        length=length,
        width=width,
    )


def draw_drivers(rng: np.random.Generator) -> tuple[Driver, ...]:
    return tuple(draw_driver(rng) for _ in range(DRIVERS_PER_DRAW))
