"""Intervals: published examples, and what a bootstrap must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import DataObject, data, integers, sampled_from
from scipy.stats import binomtest

from tsbench.geometry.polyline import Array
from tsbench.metrics.intervals import MIN_CLUSTERS, ClusterBootstrap, wilson


# Newcombe (1998), Statistics in Medicine 17, 857-872, table I, method 3 (Wilson score).
@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0000, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_as_published(successes: int, n: int, low: float, high: float) -> None:
    assert wilson(successes, n) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))


@given(data())
def test_wilson_as_scipy_has_it(draw: DataObject) -> None:
    n = draw.draw(integers(1, 20_000))
    successes = draw.draw(integers(0, n) | sampled_from([0, n]))
    theirs = binomtest(successes, n).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson(successes, n) == (
        pytest.approx(theirs.low, abs=1e-12),
        pytest.approx(theirs.high, abs=1e-12),
    )


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


def test_a_bootstrap_of_means_is_near_the_normal_interval() -> None:
    rates = np.random.default_rng(0).integers(0, 11, 200) / 10
    estimate = ClusterBootstrap("hash").estimate("x", *binary(rates.tolist()), 1.0, True)
    error = rates.std() / np.sqrt(len(rates))
    assert estimate.value == pytest.approx(rates.mean())
    assert estimate.low == pytest.approx(rates.mean() - 1.96 * error, abs=0.15 * error)
    assert estimate.high == pytest.approx(rates.mean() + 1.96 * error, abs=0.15 * error)
    assert (estimate.method, estimate.n, estimate.clusters) == ("cluster bootstrap", 2000, 200)


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


def test_clusters_count_not_episodes() -> None:
    few = ClusterBootstrap("h").estimate("x", *binary([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], 5), 1.0, True)
    more = ClusterBootstrap("h").estimate("x", *binary([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], 500), 1.0, True)
    assert (few.low, few.high) == (more.low, more.high)


def test_fewer_than_five_clusters_have_no_interval() -> None:
    estimate = ClusterBootstrap("h").estimate("x", *binary([0.1, 0.5, 0.5, 0.9]), 100.0, True)
    assert (estimate.value, estimate.low, estimate.high) == (50.0, None, None)
    assert estimate.reason == f"only 4 places, fewer than {MIN_CLUSTERS}"


def test_one_episode_on_each_map_is_wilson() -> None:
    total = np.array([[1.0]] * 81 + [[0.0]] * 182)
    estimate = ClusterBootstrap("h").estimate("x", total, np.ones((263, 1)), 1.0, True)
    assert estimate.method == "wilson"
    assert (estimate.low, estimate.high) == (pytest.approx(0.2553, abs=5e-5), pytest.approx(0.3662, abs=5e-5))


def test_maps_that_are_all_alike_claim_no_certainty() -> None:
    estimate = ClusterBootstrap("h").estimate("x", *binary([0.0] * 20), 1.0, True)
    assert (estimate.method, estimate.low, estimate.high) == ("wilson", 0.0, pytest.approx(0.1611, abs=5e-5))
    plain = ClusterBootstrap("h").estimate("x", np.full((20, 1), 7.0), np.ones((20, 1)), 1.0, False)
    assert (plain.value, plain.low, plain.reason) == (7.0, None, "all places alike")


def one_type_passed(places: int = 40, types: int = 4) -> tuple[Array, Array]:
    """Each place has episodes of two types; the first type is passed everywhere, the others nowhere."""
    count = np.zeros((places, types))
    for k in range(places):
        count[k, [k % types, (k + 1) % types]] = 10
    total = np.zeros_like(count)
    total[:, 0] = count[:, 0]
    return total, count


def test_types_that_are_wholly_passed_or_failed_claim_no_certainty() -> None:
    """Places differ, as they have different types, but the macro mean is the same in every draw."""
    total, count = one_type_passed()
    estimate = ClusterBootstrap("h").estimate("x", total, count, 100.0, True)
    # Wilson of 10 in 40.
    assert (estimate.value, estimate.method) == (25.0, "wilson")
    assert (estimate.low, estimate.high) == (pytest.approx(14.19, abs=0.01), pytest.approx(40.19, abs=0.01))
    plain = ClusterBootstrap("h").estimate("x", total, count, 1.0, False)
    assert (plain.low, plain.high, plain.reason) == (None, None, "places of a type alike")


def test_a_type_that_few_draws_lack_gives_no_interval_without_width() -> None:
    total, count = one_type_passed(16, 2)
    # Of the second type at four places alone: some draws lack it, fewer than one in forty.
    count[4:, 1] = 0
    count[4:, 0] = total[4:, 0] = 10
    count[:4, 0] = total[:4, 0] = 0
    draws = ClusterBootstrap("h").draws("x", total, count)
    assert np.ptp(draws) > 0.0
    estimate = ClusterBootstrap("h").estimate("x", total, count, 100.0, True)
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 50.0 < estimate.high


def test_macro_mean_weighs_parts_alike() -> None:
    total = np.zeros((30, 2))
    count = np.zeros((30, 2))
    count[:10, 0], total[:10, 0] = 10, np.arange(10)
    count[10:, 1], total[10:, 1] = 1, 1
    estimate = ClusterBootstrap("h").estimate("x", total, count, 1.0, True)
    assert estimate.value == pytest.approx((0.45 + 1.0) / 2)
    assert estimate.parts == 2
    assert estimate.low is not None
    assert estimate.high is not None
    assert estimate.low < 0.725 < estimate.high


def test_nothing_to_average() -> None:
    estimate = ClusterBootstrap("h").estimate("x", np.zeros((0, 1)), np.zeros((0, 1)), 1.0, True)
    assert (estimate.value, estimate.n, estimate.reason) == (None, 0, "no episode")
