"""Calibration: KS distances of samples whose distance is known, and what is taken from the tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from simworld import CALM, SceneMaker, loader_of, simulation, speed_plate

from tsbench.core.errors import InputError
from tsbench.make.scenes.recipe import INITIAL_SPEEDS_MPS, variants_of
from tsbench.make.scenes.traffic import Car
from tsbench.metrics.calibration import (
    Quantiles,
    calibrate,
    driven_speeds,
    grid_speeds,
    ks_distance,
    published,
    sample_rows,
)
from tsbench.report.analyses.traffic_calibration import calibration
from tsbench.report.charts import save_chart
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.nuplan import quantile, quantile_speed
from tsbench.sim.scene import EgoStart

SHARES = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
UNIFORM = Quantiles("uniform", "1", SHARES, SHARES.copy())
EVEN = (np.arange(10_000) + 0.5) / 10_000


@pytest.mark.parametrize(
    ("sample", "distance"),
    [
        (EVEN, 0.0),
        (EVEN + 0.2, 0.2),
        (EVEN - 0.1, 0.1),
        # Twice as wide around the same median: |x - (0.25 + x / 2)| is greatest where the range ends.
        (2.0 * EVEN - 0.5, 0.225),
        (np.full(50, 0.5), 0.5),
        (np.full(50, 3.0), 0.95),
        (np.full(50, -3.0), 0.95),
        (np.repeat([0.25, 0.5, 0.75], 100), 0.25),
    ],
)
def test_known_distances(sample: np.ndarray, distance: float) -> None:
    assert ks_distance(sample, UNIFORM) == pytest.approx(distance, abs=1e-3)
    assert ks_distance(sample[::-1], UNIFORM) == ks_distance(sample, UNIFORM)


def test_a_sample_drawn_from_the_published_quantiles_is_near() -> None:
    speeds = np.array([quantile_speed(float(u)) for u in EVEN[::10]])
    assert ks_distance(speeds, published("speed", "speed_mps", "m/s")) < 0.002


def test_variants_of_many_maps_are_as_near_as_the_goal_asks() -> None:
    drawn = [v for k in range(100) for v in variants_of("yield", f"m{k}")[1:]]
    speeds = np.array([v.initial_speed for v in drawn])
    densities = np.array([v.density for v in drawn])
    assert ks_distance(speeds, published("it", "initial_speed_mps", "")) < 0.02
    assert ks_distance(densities, published("it", "moving_cars_per_lane_within_150m", "")) < 0.06


def test_the_three_comparisons_and_their_figure(tmp_path: Path) -> None:
    speeds = np.array([quantile_speed(float(u)) for u in EVEN[::10]])
    densities = np.array([quantile("moving_cars_per_lane_within_150m", float(u)) for u in EVEN[::10]])
    fits = calibrate(np.repeat(INITIAL_SPEEDS_MPS, 10), speeds, np.full(20, 4.0) / 0.3)
    assert [f.quantiles.name for f in fits] == ["initial speed", "cruise speed", "density"]
    assert [f.good for f in fits] == [False, None, False]
    assert [f.good for f in calibrate(speeds, speeds, densities / 0.3)] == [True, None, True]
    assert fits[1].distance < 0.01
    analysis = calibration(fits, "test")
    assert analysis.draw is not None
    save_chart(analysis.draw, tmp_path / "made" / "cdf.png")
    with Image.open(tmp_path / "made" / "cdf.png") as picture:
        assert picture.width > 2.5 * picture.height
        assert len(picture.convert("RGB").getcolors(1_000_000) or ()) > 10


def test_an_empty_sample_is_named() -> None:
    some = np.ones(3)
    for k, name in enumerate(("initial speed", "cruise speed", "density")):
        parts = [np.zeros(0) if i == k else some for i in range(3)]
        with pytest.raises(InputError, match=f"no {name} to compare"):
            calibrate(*parts)


@pytest.fixture
def busy(on_road: SceneMaker) -> ScenarioSpec:
    """Two background cars at 6 m/s, and one of the scene's own."""
    cars = [Car(f"{name}_{k}", 0, 0.0, ("road",), k, 100.0) for k, name in enumerate(("bg", "bg", "other"))]
    spec = on_road.make(
        "busy", EgoStart("road_0", 20.0, 8.0), Destination("road", 280.0), ("road",),
        speed_plate(on_road.network, "road", 200.0), cars=cars, drivers=(replace(CALM, speed=6.0),),
    )  # fmt: skip
    return replace(spec, density=4.0, variant=1, group="priority", initial_speed=8.0)


def test_speeds_are_those_of_moving_background_cars(busy: ScenarioSpec, net_folder: Path) -> None:
    seen: list[int] = []
    speeds = driven_speeds([busy, busy], simulation(), loader_of(net_folder), seen.append)
    assert seen == [1, 2]
    # 200 m at 6 m/s, every half second, two cars, twice.
    assert len(speeds) == pytest.approx(2 * 2 * 60, abs=12)
    assert np.median(speeds) == pytest.approx(6.0, abs=0.2)


def test_rows_that_count(busy: ScenarioSpec) -> None:
    rows = [
        replace(busy, scenario_id=f"s{k}", variant=k % 10, group=g, density=4.0 * (k % 10 > 0), initial_speed=float(k))
        for k, g in enumerate(["priority"] * 20 + ["speed"] * 20)
    ]
    assert grid_speeds(rows).tolist() == [float(k) for k in range(20) if k % 10]
    chosen = sample_rows(rows, 5)
    assert len({r.scenario_id for r in chosen}) == 5
    assert all(r.density > 0 for r in chosen)
    assert sample_rows(rows[::-1], 5) == chosen
