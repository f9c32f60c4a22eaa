"""Seeds, variants and drivers: the same on every machine."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.core.seeds import rng_of, seed_of
from tsbench.make.scenes.recipe import LAYOUTS, ROUTE_LENGTHS_M, Variant, variants_of
from tsbench.make.scenes.traffic import BODIES, draw_driver, draw_drivers
from tsbench.sim.nuplan import quantile, quantile_speed, statistics

NAMES = st.text(st.characters(min_codepoint=32), max_size=20)


def test_seeds_never_change() -> None:
    """Golden values: another hash would make every committed scene another one."""
    assert seed_of("scenario", "yield-j-nok-0-v0") == 949628982
    assert seed_of("a", 1) == 3691409724
    assert seed_of("a1") == 3304406986
    assert rng_of("x").integers(0, 1000, 5).tolist() == [296, 892, 398, 403, 123]


def test_variants_never_change() -> None:
    first, second, third = variants_of("yield", "j-nok-1a8ecee4e9")[:3]
    assert first == Variant(0, 60.0, 0.0, 7.75, -1, 4, 3, 1, 0)
    assert second == Variant(1, 73.7, 3.26, 7.05, 2, 0, 4, 6, 3)
    assert third == Variant(2, 68.2, 4.61, 4.28, 1, 0, 5, 7, 0)


def test_neither_hash_seed_nor_order_matters() -> None:
    code = "from tsbench.make.scenes.recipe import variants_of as v; print(v('yield', 'b'), v('yield', 'a'))"
    told = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": seed}
        ).stdout
        for seed in ("1", "2")
    }
    assert told == {f"{variants_of('yield', 'b')} {variants_of('yield', 'a')}\n"}


@given(NAMES, NAMES)
def test_ten_variants_the_first_nominal_the_others_in_a_ninth_each(scenario_type: str, map_id: str) -> None:
    nominal, *rest = variants_of(scenario_type, map_id)
    assert [v.number for v in (nominal, *rest)] == list(range(10))
    assert (nominal.density, nominal.drivers, nominal.initial_speed) == (0.0, -1, 7.75)
    assert nominal.cars_per_lane_km == 0.0
    low, high = ROUTE_LENGTHS_M
    lengths = sorted((v.route_length - low) / (high - low) for v in rest)
    assert all(k / 9 - 1e-3 <= share <= (k + 1) / 9 + 1e-3 for k, share in enumerate(lengths))
    assert min(v.initial_speed for v in rest) >= 1.0
    assert all(0.5 <= v.density <= 9.0 for v in rest)
    assert Counter(v.drivers for v in rest) == {0: 3, 1: 3, 2: 3}
    assert {v.layout for v in rest} == set(range(LAYOUTS))


@given(st.floats(60.0, 120.0), st.floats(0.0, 100.0), st.floats(0.0, 300.0))
def test_routes_end_on_the_map_and_no_sooner_than_the_type_needs(asked: float, least: float, more: float) -> None:
    room = least + more
    end = Variant(1, asked, 4.0, 7.75, 0, 0).route_end(least, room)
    assert least - 0.06 <= end <= room + 0.06
    assert end <= max(120.0, least) + 0.06


def test_routes_of_a_short_map_end_apart() -> None:
    ends = {v.route_end(25.0, 62.0) for v in variants_of("yield", "m")[1:]}
    assert len(ends) == 9
    assert max(ends) - min(ends) > 20.0


def test_maps_and_types_get_variants_of_their_own() -> None:
    drawn = {variants_of(t, f"m{k}")[1:] for t in ("yield", "speed_limit") for k in range(20)}
    assert len(drawn) == 40


@given(NAMES, NAMES, NAMES)
def test_names_do_not_run_into_each_other(a: str, b: str, c: str) -> None:
    assert seed_of(a, b, c) == seed_of(a, b, c)
    assert (seed_of(a + b, c) == seed_of(a, b + c)) == (a + b == a and c == b + c)
    assert 0 <= seed_of(a) < 2**32


def test_speeds_are_the_published_quantiles() -> None:
    table = statistics()["speed_mps"]
    for share, name in ((0.05, "p5"), (0.5, "p50"), (0.85, "p85"), (0.99, "p99")):
        assert quantile_speed(share) == pytest.approx(table[name])
    shares = np.linspace(0.0, 1.0, 101)
    assert (np.diff([quantile_speed(float(s)) for s in shares]) > 0).all()


def test_figures_go_on_beyond_the_outermost_quantiles() -> None:
    assert quantile("initial_speed_mps", 0.25) == 3.61
    assert quantile("initial_speed_mps", 0.625) == pytest.approx((7.75 + 11.05) / 2)
    assert quantile("initial_speed_mps", 1.0) == pytest.approx(11.05 + (11.05 - 7.75))
    assert quantile("initial_speed_mps", 0.0) == pytest.approx(3.61 - (7.75 - 3.61))


def test_drivers_are_people() -> None:
    rng = np.random.default_rng(5)
    drivers = [draw_driver(rng) for _ in range(1500)]
    speed = np.array([d.speed for d in drivers])
    assert speed.min() >= quantile_speed(0.4)
    assert speed.max() <= quantile_speed(1.0)
    assert all(0.8 <= d.accel <= 2.8 and 1.0 <= d.decel <= 3.5 for d in drivers)
    assert all(0.8 <= d.headway <= 3.0 and 1.5 <= d.gap <= 3.0 for d in drivers)
    assert {(d.length, d.width) for d in drivers} <= set(BODIES.values())
    middle = sum(d.length == BODIES["m"][0] for d in drivers) / len(drivers)
    assert middle == pytest.approx(0.79, abs=0.04)


def test_a_draw_of_drivers_depends_on_its_seed_only() -> None:
    assert draw_drivers(rng_of("drivers", "t", "m", 0)) == draw_drivers(rng_of("drivers", "t", "m", 0))
    assert draw_drivers(rng_of("drivers", "t", "m", 0)) != draw_drivers(rng_of("drivers", "t", "m", 1))
