"""Intervals: published examples, and what a bootstrap must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis.strategies import DataObject, DrawFn, booleans, composite, data, integers, sampled_from
from statsmodels.stats.proportion import proportion_confint

from tsbench.geometry.polyline import Array
from tsbench.metrics.intervals import MIN_CLUSTERS, ClusterBootstrap, share_ends, share_interval


@given(n=integers(1, 2_000), passed=data())
def test_the_ends_of_a_share_are_jeffreys_s(n: int, passed: DataObject) -> None:
    x = passed.draw(integers(0, n) | sampled_from([0, n]))
    (low,), (high,) = share_ends(np.array([x / n]), np.array([float(n)]))
    theirs = proportion_confint(x, n, method="jeffreys")
    assert low == (0.0 if x == 0 else pytest.approx(theirs[0], rel=1e-9))
    assert high == (1.0 if x == n else pytest.approx(theirs[1], rel=1e-9))


def binary(rates: list[float], n: int = 10) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[round(r * n)] for r in rates], dtype=float), np.full((len(rates), 1), float(n))


def test_draws_are_those_of_the_seed_and_the_label() -> None:
    a, b = ClusterBootstrap("hash"), ClusterBootstrap("hash")
    assert np.array_equal(a.weights("overall", 20), b.weights("overall", 20))
    assert not np.array_equal(a.weights("overall", 20), a.weights("type yield", 20))
    assert not np.array_equal(a.weights("overall", 20), ClusterBootstrap("other").weights("overall", 20))
    weights = a.weights("overall", 20)
    assert weights.shape == (10_000, 20)
    assert (weights.sum(axis=1) == 20).all()
    assert weights.mean() == 1.0


def test_a_bootstrap_of_clusters_as_published() -> None:
    # Efron and Tibshirani (1993), An Introduction to the Bootstrap, section 10.3, the patch data: a ratio of two sums,
    # the eight subjects drawn whole, as maps with different numbers of episodes are here. -0.0713, standard error
    # 0.105 (from 400 draws).
    total = np.array([-1200, 2601, -2705, 1982, -1290, 351, -638, -2719], dtype=float)[:, None]
    count = np.array([8406, 2342, 8187, 8459, 4795, 3516, 4796, 10238], dtype=float)[:, None]
    bootstrap = ClusterBootstrap("hash")
    estimate = bootstrap.estimate("x", total, count, 1.0, False)
    assert estimate.value == pytest.approx(-0.0713, abs=5e-5)
    draws = bootstrap.draws("x", total, count)
    assert draws.std(ddof=1) == pytest.approx(0.105, rel=0.05)
    assert (estimate.low, estimate.high) == pytest.approx(np.quantile(draws, [0.025, 0.975]))


def test_a_bootstrap_of_a_mean_as_published() -> None:
    # Efron and Tibshirani (1993), table 2.1: mean survival of the seven treated mice 86.86 days, 23.36 its standard
    # error in the limit of many draws.
    days = np.array([94, 197, 16, 38, 99, 141, 23], dtype=float)[:, None]
    draws = ClusterBootstrap("hash").draws("x", days, np.ones((7, 1)))
    assert draws.mean() == pytest.approx(86.86, abs=1.0)
    assert draws.std(ddof=1) == pytest.approx(23.36, rel=0.025)


def test_fewer_than_five_clusters_have_no_interval() -> None:
    estimate = ClusterBootstrap("h").estimate("x", *binary([0.1, 0.5, 0.5, 0.9]), 100.0, True)
    assert (estimate.value, estimate.low, estimate.high) == (50.0, None, None)
    assert estimate.reason == f"only 4 places, fewer than {MIN_CLUSTERS}"


def test_means_that_are_alike_at_all_places_have_no_interval() -> None:
    plain = ClusterBootstrap("h").estimate("x", np.full((20, 1), 7.0), np.ones((20, 1)), 1.0, False)
    assert (plain.value, plain.low, plain.reason) == (7.0, None, "all places alike")


Table = tuple[Array, Array]


@composite
def tables(draw: DrawFn) -> Table:
    """Passes and episodes of 5 to 40 places in 1 to 5 types."""
    rng = np.random.default_rng(draw(integers(0, 2**32)))
    places, parts = draw(integers(5, 40)), draw(integers(1, 5))
    count = rng.integers(0, draw(sampled_from([3, 5, 12])), size=(places, parts)).astype(float)
    count[0] = np.maximum(count[0], 1.0)
    count = count[count.sum(axis=1) > 0.0]
    rate = draw(sampled_from([0.0, 0.02, 0.3, 0.7, 0.98, 1.0]))
    rates = rng.beta(rate + 0.02, 1.02 - rate, size=count.shape) if draw(booleans()) else rate
    return rng.binomial(count.astype(int), rates).astype(float), count


@given(tables(), integers(0, 2**32))
def test_one_more_pass_lowers_no_end(table: Table, seed: int) -> None:
    total, count = table
    failed = np.argwhere(total < count)
    assume(len(failed))
    before = share_interval(total, count)
    total[tuple(failed[seed % len(failed)])] += 1.0
    after = share_interval(total, count)
    assert after[0] >= before[0] - 1e-12
    assert after[1] >= before[1] - 1e-12


@given(tables())
def test_a_mean_is_no_surer_than_any_of_its_types(table: Table) -> None:
    total, count = table
    parts = count.shape[1]
    low, high = share_interval(total, count)
    mean = float((total.sum(axis=0) / count.sum(axis=0)).mean())
    assert low <= mean <= high
    for k in range(parts):
        held = count[:, k] > 0.0
        one, its = total[held][:, [k]], count[held][:, [k]]
        share, (below, above) = one.sum() / its.sum(), share_interval(one, its)
        assert mean - low >= (share - below) / parts - 1e-12
        assert high - mean >= (above - share) / parts - 1e-12


def test_as_many_episodes_at_fewer_places_are_less_sure() -> None:
    everywhere = share_interval(np.tile([[1.0], [0.0]], (30, 1)), np.ones((60, 1)))
    alike = share_interval(np.tile([[6.0], [0.0]], (5, 1)), np.full((10, 1), 6.0))
    assert alike[0] < everywhere[0] < 0.5 < everywhere[1] < alike[1]


@pytest.mark.parametrize("correlation", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("rate", [0.2, 0.5])
def test_intervals_hold_the_rate_in_95_of_100_tables(rate: float, correlation: float) -> None:
    """packaging/interval_coverage.py does it for more cases."""
    rng = np.random.default_rng(0)
    count = np.tile([[1.0], [2.0], [3.0]], (7, 1))
    held = 0
    for _ in range(400):
        odds = 1.0 / correlation - 1.0 if correlation else 0.0
        at = rng.beta(rate * odds, (1.0 - rate) * odds, size=count.shape) if odds else rate
        low, high = share_interval(rng.binomial(count.astype(int), at).astype(float), count)
        held += low <= rate <= high
    assert 0.93 <= held / 400 <= 0.99


def test_macro_mean_weighs_parts_alike() -> None:
    total = np.zeros((30, 2))
    count = np.zeros((30, 2))
    count[:10, 0], total[:10, 0] = 10, np.arange(10)
    count[10:, 1], total[10:, 1] = 1, 1
    estimate = ClusterBootstrap("h").estimate("x", total, count, 1.0, True)
    assert estimate.value == pytest.approx((0.45 + 1.0) / 2)
    assert estimate.parts == 2
    assert estimate.high is not None
    assert estimate.low < 0.725 < estimate.high


def test_nothing_to_average() -> None:
    estimate = ClusterBootstrap("h").estimate("x", np.zeros((0, 1)), np.zeros((0, 1)), 1.0, True)
    assert (estimate.value, estimate.n, estimate.reason) == (None, 0, "no episode")
