"""How near the built scenarios come to nuPlan's traffic: empirical CDFs and KS distances.

Source: docs/simulation.md, "Traffic". The published nuPlan figures are quantiles; between them their CDF is taken
as linear, beyond the outermost nothing is compared. Units: m/s, and moving cars per lane within 150 m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tsbench.core.errors import InputError
from tsbench.core.seeds import seed_of
from tsbench.geometry.polyline import Array
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.nuplan import DENSITY_KEY, LANE_KM_WITHIN_REACH, SPEED_KEY, quantiles
from tsbench.sim.world import DT_S

if TYPE_CHECKING:
    from tsbench.sim.sumo import Simulation

GOAL = 0.10
# nuPlan's own bounds of "moving".
MOVING_MPS = (0.5, 40.0)
SPEEDS_OVER_S = 30.0
SPEEDS_EVERY_TICKS = 5
# Its scenes choose the ego's speed by the plate, not by the grid.
OWN_SPEEDS = "speed"


@dataclass(frozen=True)
class Quantiles:
    """Published quantiles: `share` (k,) in (0, 1) increasing, `value` (k,) increasing, in `unit`."""

    name: str
    unit: str
    share: Array
    value: Array

    def cdf(self, x: Array) -> Array:
        """Share of nuPlan's values below x (n,); constant beyond the outermost quantiles."""
        below: Array = np.interp(x, self.value, self.share)
        return below


@dataclass(frozen=True)
class Fit:
    """A sample against its quantiles. `sample`: sorted. distance: KS over the range of the published quantiles.

    good: is the distance within the goal? None where there is no goal.
    """

    quantiles: Quantiles
    sample: Array
    distance: float
    good: bool | None


def published(name: str, key: str, unit: str) -> Quantiles:
    """The quantiles (`p5`, `p25`, ...) of one of the published figures."""
    return Quantiles(name, unit, *quantiles(key))


def ks_distance(sample: Array, quantiles: Quantiles) -> float:
    """Kolmogorov-Smirnov distance between a sample (n,) and nuPlan's CDF between its outermost quantiles."""
    sample = np.sort(sample)
    low, high = quantiles.value[0], quantiles.value[-1]
    inside = sample[(sample >= low) & (sample <= high)]
    at = np.concatenate((inside, quantiles.value))
    wanted = quantiles.cdf(at)
    upto = np.searchsorted(sample, at, side="right") / len(sample)
    before = np.searchsorted(sample, at, side="left") / len(sample)
    # Just before the lowest and just after the highest quantile is outside the range.
    before[at == low] = upto[at == low]
    upto[at == high] = before[at == high]
    return float(max(np.abs(upto - wanted).max(), np.abs(before - wanted).max()))


def calibrate(initial_speeds: Array, cruise_speeds: Array, densities: Array) -> list[Fit]:
    """The three comparisons.

    initial_speeds: (n,) m/s of egos whose speed the grid gives. cruise_speeds: (m,) m/s of moving background cars.
    densities: (k,) realised cars per lane-km, of scenes with traffic. Raises InputError where one is empty.
    """
    parts = (
        (published("initial speed", SPEED_KEY, "m/s"), initial_speeds, True),
        (published("cruise speed", "speed_mps", "m/s"), cruise_speeds, False),
        (
            published("density", DENSITY_KEY, "moving cars per lane within 150 m"),
            densities * LANE_KM_WITHIN_REACH,
            True,
        ),
    )
    fits = []
    for of, sample, has_goal in parts:
        if not len(sample):
            raise InputError(f"calibration: the scenarios have no {of.name} to compare (all without traffic?)")
        distance = ks_distance(sample, of)
        fits.append(Fit(of, np.sort(sample), distance, distance <= GOAL if has_goal else None))
    return fits


def grid_speeds(rows: Sequence[ScenarioSpec]) -> Array:
    """Initial speeds (n,) that the grid gave: not those of nominal variants, nor where the plate decides them."""
    return np.array([r.initial_speed for r in rows if r.variant and r.group != OWN_SPEEDS])


def sample_rows(rows: Sequence[ScenarioSpec], count: int) -> list[ScenarioSpec]:
    """So many rows with traffic, by a stable hash."""
    busy = [r for r in rows if r.density > 0]
    return sorted(busy, key=lambda r: seed_of("calibration", r.scenario_id))[:count]


def driven_speeds(
    rows: Sequence[ScenarioSpec], sim: Simulation, loader: SceneLoader, progress: Callable[[int], None]
) -> Array:
    """Speeds (m,) of moving background cars in the first 30 s of scenes, every half second; SUMO drives the ego too."""
    found: list[float] = []
    for k, row in enumerate(rows):
        scene, _ = loader.load(row)
        sim.load_scene(scene)
        for tick in range(int(SPEEDS_OVER_S / DT_S)):
            sim.step()
            if tick % SPEEDS_EVERY_TICKS == 0:
                found += sim.speeds("bg_")
        progress(k + 1)
    speeds = np.array(found, dtype=np.float64)
    return speeds[(speeds >= MOVING_MPS[0]) & (speeds <= MOVING_MPS[1])]
