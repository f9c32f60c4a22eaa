"""How near the built scenarios come to nuPlan's traffic: empirical CDFs and KS distances.

Source: docs/simulation.md, "Traffic". The published nuPlan figures are quantiles; between them their CDF is taken
as linear, beyond the outermost nothing is compared. Units: m/s, and moving cars per lane within 150 m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tsbench.core.errors import InputError
from tsbench.dataset.scenes.variants import LANE_KM_WITHIN_REACH
from tsbench.dataset.seeds import seed_of
from tsbench.geometry.polyline import Array
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.nuplan import statistics
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

GOAL = 0.10
PROBES = (0.25, 0.5, 0.75)
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

    at_probes: KS with both rounded to the grid's own levels; NaN where the grid asks for none.
    """

    quantiles: Quantiles
    sample: Array
    distance: float
    at_probes: float

    @property
    def good(self) -> bool | None:
        """Within the goal at the grid's levels; None where there is no goal."""
        return None if np.isnan(self.at_probes) else self.at_probes <= GOAL

    @property
    def near(self) -> bool | None:
        """Within the goal unrounded; None where there is no goal."""
        return None if self.good is None else self.distance <= GOAL


def published(name: str, key: str, unit: str) -> Quantiles:
    """The quantiles (`p5`, `p25`, ...) of one of the published figures."""
    table = {float(k[1:]) / 100: float(v) for k, v in statistics()[key].items() if k[1:].isdigit()}
    share = sorted(table)
    return Quantiles(name, unit, np.array(share), np.array([table[s] for s in share]))


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


def probe_distance(sample: Array, quantiles: Quantiles) -> float:
    """The same with both sides rounded to the nearest of the levels that the grid asks for (nuPlan's 25, 50, 75 %).

    It is blind to the spread around a level, and sees where scenes of two levels are the same traffic.
    """
    level = np.interp(PROBES, quantiles.share, quantiles.value)
    border = (level[1:] + level[:-1]) / 2
    below = np.searchsorted(np.sort(sample), border) / len(sample)
    return float(np.abs(below - quantiles.cdf(border)).max())


def calibrate(initial_speeds: Array, cruise_speeds: Array, densities: Array) -> list[Fit]:
    """The three comparisons.

    initial_speeds: (n,) m/s of egos whose speed the grid gives. cruise_speeds: (m,) m/s of moving background cars.
    densities: (k,) realised cars per lane-km, of scenes with traffic. Raises InputError where one is empty.
    """
    parts = (
        (published("initial speed", "initial_speed_mps", "m/s"), initial_speeds, True),
        (published("cruise speed", "speed_mps", "m/s"), cruise_speeds, False),
        (
            published("density", "moving_cars_per_lane_within_150m", "moving cars per lane within 150 m"),
            densities * LANE_KM_WITHIN_REACH,
            True,
        ),
    )
    for q, x, _ in parts:
        if not len(x):
            raise InputError(f"calibration: the scenarios have no {q.name} to compare (all without traffic?)")
    return [
        Fit(q, np.sort(x), ks_distance(x, q), probe_distance(x, q) if probed else float("nan"))
        for q, x, probed in parts
    ]


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
