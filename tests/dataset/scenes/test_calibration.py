"""Calibration: KS distances of samples whose distance is known, and what is taken from the tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from simworld import CALM, SceneMaker, simulation, speed_plate

from tsbench.core.errors import InputError
from tsbench.dataset.scenes.calibration import (
    GOAL,
    Quantiles,
    calibrate,
    driven_speeds,
    grid_speeds,
    ks_distance,
    probe_distance,
    published,
    sample_rows,
)
from tsbench.dataset.scenes.traffic import Car
from tsbench.dataset.scenes.variants import DENSITIES, INITIAL_SPEEDS_MPS
from tsbench.report.analyses.traffic_calibration import calibration
from tsbench.report.tables.charts import save_chart
from tsbench.roads.destination import Destination
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneFolder
from tsbench.sim.nuplan import quantile_speed
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


def test_levels_of_the_grid_meet_the_goal_and_two_that_are_one_do_not() -> None:
    rng = np.random.default_rng(1)
    for key, levels in (
        ("moving_cars_per_lane_within_150m", DENSITIES),
        ("initial_speed_mps", INITIAL_SPEEDS_MPS),
    ):
        quantiles = published("it", key, "")
        asked = np.repeat(levels, 300)
        assert probe_distance(asked, quantiles) == pytest.approx(0.375 - 1 / 3, abs=1e-6)
        realised = asked * rng.uniform(0.9, 1.1, len(asked))
        assert probe_distance(realised, quantiles) == pytest.approx(0.375 - 1 / 3, abs=1e-6)
        saturated = np.minimum(asked, levels[1])
        assert probe_distance(saturated, quantiles) == pytest.approx(0.375, abs=1e-6)
        assert probe_distance(saturated, quantiles) > GOAL


def test_the_three_comparisons_and_their_figure(tmp_path: Path) -> None:
    speeds = np.array([quantile_speed(float(u)) for u in EVEN[::10]])
    fits = calibrate(np.repeat(INITIAL_SPEEDS_MPS, 10), speeds, np.repeat(DENSITIES, 10) / 0.3)
    assert [f.quantiles.name for f in fits] == ["initial speed", "cruise speed", "density"]
    assert [f.good for f in fits] == [True, None, True]
    assert [f.near for f in fits] == [False, None, False]  # three levels are no continuous distribution
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
    speeds = driven_speeds([busy, busy], simulation(), SceneLoader(SceneFolder(net_folder)), seen.append)
    assert seen == [1, 2]
    # 200 m at 6 m/s, every half second, two cars, twice.
    assert len(speeds) == pytest.approx(2 * 2 * 60, abs=12)
    assert np.median(speeds) == pytest.approx(6.0, abs=0.2)


def test_rows_that_count(busy: ScenarioSpec) -> None:
    rows = [
        replace(
            busy,
            scenario_id=f"s{k}",
            variant=k % 10,
            group=g,
            density=4.0 * (k % 10 > 0),
            initial_speed=float(k),
        )
        for k, g in enumerate(["priority"] * 20 + ["speed"] * 20)
    ]
    assert grid_speeds(rows).tolist() == [float(k) for k in range(20) if k % 10]
    chosen = sample_rows(rows, 5)
    assert len({r.scenario_id for r in chosen}) == 5
    assert all(r.density > 0 for r in chosen)
    assert sample_rows(rows[::-1], 5) == chosen
