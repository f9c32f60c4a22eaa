"""docs/simulation.md, metrics.md and planners.md against the code's constants."""

from __future__ import annotations

import math

import pytest
from spec_tables import numbers, table, words

from tsbench.episode import outcome
from tsbench.make.scenes import traffic
from tsbench.make.scenes.recipe import load_recipe
from tsbench.metrics import comfort
from tsbench.planners import registry
from tsbench.planners.idm import IdmS1, IdmS2, IdmS3, IdmS4
from tsbench.signs.catalog import load_catalog
from tsbench.sim import ego, nuplan, world


def test_time_and_bodies() -> None:
    page = {row["what"]: float(row["value"]) for row in table("simulation.md", "what", "value", "unit")}
    catalog = load_catalog()
    horizons = {type_.id: load_recipe(type_.id, catalog).horizon for type_ in catalog.types}
    routing = [kind.id for kind in catalog.types if kind.group == "routing"]
    (way_horizon,) = {horizons.pop(name) for name in routing}
    assert page == {
        "SUMO step = control step": world.DT_S,
        "horizon": horizons["yield"],
        "horizon of roundabout": horizons.pop("roundabout"),
        "horizon of routing types": way_horizon,
        "ego's length": world.EGO_LENGTH_M,
        "ego's width": world.EGO_WIDTH_M,
        "ego's wheelbase": world.WHEELBASE_M,
        "steering at most": pytest.approx(math.degrees(ego.MAX_STEER_RAD)),
        "steering rate at most": pytest.approx(math.degrees(ego.MAX_STEER_RATE_RAD_S)),
        "acceleration at most": ego.MAX_ACCEL_MPS2,
        "braking at most": ego.MAX_DECEL_MPS2,
        "speed at most": ego.MAX_SPEED_MPS,
    }
    assert len(set(horizons.values())) == 1


def test_room_around_the_start() -> None:
    page = {row["where"]: float(row["clear"]) for row in table("simulation.md", "where", "clear")}
    assert page == {
        "beside the ego": traffic.CLEAR_BESIDE_M,
        "behind it": traffic.CLEAR_BEHIND_M,
        "ahead of it, at least": traffic.CLEAR_AHEAD_M,
        "ahead of it, seconds of speed": traffic.CLEAR_AHEAD_S,
    }


def test_outcomes() -> None:
    page = {row["outcome"]: row["error"] == "yes" for row in table("metrics.md", "outcome", "error")}
    assert page == {out.value: out.is_error for out in outcome.Outcome}


def test_comfort() -> None:
    page = [(float(row["low"]), float(row["high"])) for row in table("metrics.md", "quantity", "low", "high")]
    both = (
        comfort.LATERAL_MPS2,
        comfort.YAW_RATE_RAD_S,
        comfort.YAW_ACCELERATION_RAD_S2,
        comfort.LONGITUDINAL_JERK_MPS3,
        comfort.JERK_MPS3,
    )
    assert page == [comfort.LONGITUDINAL_MPS2, *((-bound, bound) for bound in both)]


def test_the_planners_are_those_that_are_registered() -> None:
    rows = table("planners.md", "planners", "experts")
    page = {name for row in rows for column in ("planners", "experts") for name in words(row[column])}
    assert len(page) == 30
    assert page == {name for name in registry.names() if registry.entry(name).target.startswith("tsbench.")}


def test_styles() -> None:
    page = table("planners.md", "style", "band from, %")
    for row, style in zip(page, (IdmS1, IdmS2, IdmS3, IdmS4), strict=True):
        low, high = (numbers(row[column])[0] / 100 for column in ("band from, %", "band to, %"))
        assert (low, high) == style.band
        cruise = [3.6 * nuplan.quantile_speed(share) for share in style.band]
        assert numbers(row["cruise speed about, km/h"]) == pytest.approx(cruise, abs=0.6)
