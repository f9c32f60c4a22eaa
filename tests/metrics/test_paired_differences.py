"""Paired differences: published examples, brute force, and what a comparison must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import binom
from table_builders import random_rows, records, row

from tsbench.core.errors import InputError
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.intervals import ClusterBootstrap
from tsbench.metrics.paired_differences import (
    Comparison,
    Difference,
    Pairs,
    adjust,
    compare,
    detectable,
    difference,
    holm,
    mcnemar_p,
    mcnemar_power,
)
from tsbench.metrics.scd import SCD

COMFORT = METRICS["comfort"]


def test_mcnemar_as_published() -> None:
    # Fagerland, Lydersen and Laake (2013), BMC Med Res Methodol 13:91: airway hyper-responsiveness of 21 children
    # before and after stem cell transplantation, 1 and 7 discordant; exact conditional test.
    assert mcnemar_p(7, 1) == pytest.approx(0.070, abs=5e-4)
    assert mcnemar_p(1, 7) == mcnemar_p(7, 1)
    assert mcnemar_p(0, 0) == 1.0
    assert mcnemar_p(4, 4) == 1.0
    assert mcnemar_p(0, 6) == pytest.approx(2 / 64)


def test_holm_as_published() -> None:
    # The worked example of Wikipedia's "Holm-Bonferroni method": H4 and H1 are rejected at 0.05, H3 and H2 are not.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


def brute_power(n: int, lost: float, won: float, alpha: float) -> float:
    """Every (won, lost) count with its multinomial probability, kept where the test finds more won."""
    power = 0.0
    for w in range(n + 1):
        for k in range(n - w + 1):
            if w > k and mcnemar_p(w, k) <= alpha:
                power += binom.pmf(w, n, won) * binom.pmf(k, n - w, lost / (1 - won))
    return power


@pytest.mark.parametrize(
    ("n", "rare", "effect", "alpha"), [(20, 0.05, 0.4, 0.05), (14, 0.1, 0.5, 0.01), (9, 0, 0.7, 0.05)]
)
def test_power_is_that_of_every_table_counted(n: int, rare: float, effect: float, alpha: float) -> None:
    brute = brute_power(n, rare, rare + effect, alpha)
    assert mcnemar_power(n, rare, effect, alpha) == pytest.approx(brute, abs=1e-9)


def test_power_as_published() -> None:
    # G*Power 3.1 manual, chapter 5, after O'Brien (2002): 50 pairs, flips of 8 % and 32 %, exact one-sided test at 5 %:
    # power 0.839343 there. One side of a two-sided test at 10 % is that test.
    assert mcnemar_power(50, 0.08, 0.24, 0.10) == pytest.approx(0.839343, abs=2e-5)


def test_a_detectable_effect_as_published() -> None:
    # The same example turned round: at the power that it has, its difference of 24 points is what is found.
    effect = detectable(50, 4, 16, 0.10)
    assert effect < 0.24
    assert mcnemar_power(50, 0.08, effect, 0.10) == pytest.approx(0.8, abs=1e-4)


def test_detectable_where_nothing_flipped_is_six_flips() -> None:
    effect = detectable(200, 0, 0, 0.05)
    assert effect is not None
    # 2 x 0.5^6 < 0.05 < 2 x 0.5^5: six flips one way and none the other are the least that is significant.
    assert binom.sf(5, 200, effect) == pytest.approx(0.8, abs=1e-3)


def test_the_same_counts_are_worked_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables ask for them again and again."""
    effect, p = detectable(311, 5, 9, 0.05), mcnemar_p(5, 9)
    monkeypatch.setattr("scipy.optimize.brentq", None)
    monkeypatch.setattr("statsmodels.stats.contingency_tables.mcnemar", None)
    assert detectable(311, 9, 5, 0.05) == effect
    assert mcnemar_p(9, 5) == p


def test_detectable_is_near_the_formula_for_large_samples() -> None:
    n, lost = 2000, 100
    effect = detectable(n, 120, lost, 0.05)
    flips = 2 * lost / n + effect
    # Miettinen (1968): pairs needed to find `effect` with 80 % power.
    needed = ((1.96 * flips**0.5 + 0.8416 * (flips - effect**2) ** 0.5) / effect) ** 2
    assert needed == pytest.approx(n, rel=0.06)
    assert detectable(n, lost, 120, 0.05) == effect
    stricter = detectable(n, 120, lost, 0.05 / 29)
    assert stricter > effect


@pytest.mark.parametrize(("n", "won", "lost"), [(5, 0, 0), (5, 2, 3), (1, 1, 0)])
def test_too_few_pairs_detect_nothing(n: int, won: int, lost: int) -> None:
    assert detectable(n, won, lost, 0.05) is None


def test_flips_both_ways_leave_room_for_the_effect() -> None:
    effect = detectable(24, 6, 5, 0.05 / 6)
    assert 0.58 < effect < 0.8


def pairs(a: np.ndarray, b: np.ndarray, variants: int = 5, parts: int = 1) -> Pairs:
    cluster = np.arange(len(a)) // variants
    return Pairs(np.asarray(a, float), np.asarray(b, float), cluster, cluster % parts, parts)


def between(a: np.ndarray, b: np.ndarray, metric=SCD, macro: bool = False, **shape: int) -> Difference:
    return difference(ClusterBootstrap("c0ffee", 2000), "x", pairs(a, b, **shape), metric, macro)


def test_swapping_the_two_mirrors_everything() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.random(200) < 0.5, rng.random(200) < 0.6
    one, other = between(a, b), between(b, a)
    assert one.value == pytest.approx(100 * (b.mean() - a.mean()))
    assert (one.a, one.b, one.won, one.lost) == (other.b, other.a, other.lost, other.won)
    assert (one.p, one.mde) == (other.p, other.mde)
    assert (one.low, one.high) == pytest.approx((-other.high, -other.low))
    assert one.method == "effective sample size"


def test_what_is_the_same_differs_by_nothing_but_proves_little() -> None:
    a = np.random.default_rng(0).random(100) < 0.5
    d = between(a, a)
    assert (d.value, d.p, d.won, d.lost, d.significant) == (0.0, 1.0, 0, 0, False)
    # Nothing flipped in 100 pairs at 20 places: surer than 20 pairs would be, less sure than 100 at as many places.
    assert d.low == pytest.approx(-d.high)
    assert 100 * (1 - 0.05 ** (1 / 100)) < d.high < 100 * (1 - 0.05 ** (1 / 20))
    assert d.mde is not None
    plain = between(a * 0.5, a * 0.5, COMFORT)
    assert (plain.low, plain.mde, plain.p, plain.reason) == (None, None, None, "all places alike")


def test_all_won() -> None:
    d = between(np.zeros(100), np.ones(100))
    assert (d.value, d.high, d.mde, d.significant) == (100.0, 100.0, None, True)
    assert 85 < d.low < 97


def test_pairing_removes_what_the_maps_have_in_common() -> None:
    rng = np.random.default_rng(1)
    maps = np.repeat(rng.normal(0.5, 0.2, 40), 5)
    d = between(maps, maps + rng.normal(0.02, 0.01, 200), COMFORT)
    assert d.low is not None
    assert d.high is not None
    assert d.significant
    assert d.high - d.low < 1.0
    assert d.p is None


# Student (1908), Biometrika 6, 1-25, illustration I: hours of sleep gained by ten patients with either of two drugs.
FIRST = np.array([0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0])
GAIN = np.array([1.2, 2.4, 1.3, 1.3, 0.0, 1.0, 1.8, 0.8, 4.6, 1.4])
GAIN_SD = 1.17


def test_a_paired_bootstrap_as_published() -> None:
    d = between(FIRST, FIRST + GAIN, METRICS["mean_speed"], variants=1)
    assert (d.a, d.value, d.significant) == (pytest.approx(0.75), pytest.approx(1.58), True)
    # The bootstrap's standard error of a mean is Student's SD / sqrt(n): both divide by n, not n - 1.
    assert d.high - d.low == pytest.approx(2 * 1.96 * GAIN_SD / 10**0.5, rel=0.06)
    # Around 0 the difference proves nothing, and the effect that would have is 2.80 such errors.
    centred = between(FIRST, FIRST + GAIN - 1.58, METRICS["mean_speed"], variants=1)
    assert not centred.significant
    assert centred.mde == pytest.approx(2.8016 * GAIN_SD / 10**0.5, rel=0.05)


def test_mde_of_a_mean_is_2_8_standard_errors() -> None:
    rng = np.random.default_rng(2)
    noise = np.repeat(rng.normal(0, 0.1, 400), 5)
    d = between(np.zeros(2000), noise - noise.mean() + 1e-4, COMFORT)
    assert not d.significant
    assert d.mde == pytest.approx(2.8016 * 100 * noise.std() / 400**0.5, rel=0.06)


def test_macro_mean_weighs_types_alike() -> None:
    a, b = np.zeros(60), np.zeros(60)
    cluster = np.arange(60) // 2
    part = (cluster >= 25).astype(int)
    b[part == 1] = 1.0
    given = Pairs(a, b, cluster, part, 3)
    macro = difference(ClusterBootstrap("c", 500), "x", given, SCD, macro=True)
    flat = difference(ClusterBootstrap("c", 500), "x", given, SCD)
    assert (macro.value, macro.parts) == (50.0, 2)
    assert flat.value == pytest.approx(100 * 10 / 60)


def test_a_mean_over_pairs_does_not_depend_on_the_number_of_types() -> None:
    """Values that are no shares, over pairs of four types: their plain means."""
    rng = np.random.default_rng(5)
    a, b = rng.uniform(0.0, 1.0, 80), rng.uniform(0.0, 1.0, 80)
    metric = next(m for m in METRICS.values() if not m.binary and m.scale == 1.0)
    found = between(a, b, metric, parts=4)
    assert (found.a, found.b) == (pytest.approx(a.mean(), abs=0.01), pytest.approx(b.mean(), abs=0.01))
    assert found.low <= found.value <= (found.high or 0.0)


def test_few_maps_have_no_interval_but_a_p() -> None:
    d = between(np.zeros(20), np.ones(20))
    assert (d.low, d.reason) == (None, "only 4 places, fewer than 5")
    assert d.p < 0.05
    assert between(np.zeros(0), np.zeros(0)).reason == "no pair"


def test_intervals_cover_the_true_difference() -> None:
    """Clustered flips on 30 maps: 95 % intervals must hold the truth in about 95 % of 200 repetitions."""
    rng, held = np.random.default_rng(7), 0
    bootstrap = ClusterBootstrap("c", 500)
    for _ in range(200):
        chance = np.repeat(rng.beta(1, 3, 30), 5)
        won = rng.random(150) < chance
        d = difference(bootstrap, "x", pairs(np.zeros(150), won), SCD)
        assert d.high is not None
        held += d.low <= 25.0 <= d.high
    assert 0.88 <= held / 200 <= 0.99


def test_adjusting_takes_all_tested_types_together() -> None:
    made = {k: between(np.zeros(50), np.arange(50) < n) for k, n in (("x", 6), ("y", 6), ("z", 12))}
    assert all(d.significant for d in made.values())
    done = adjust({**made, "empty": Difference()}, SCD.scale)
    assert [done[k].p_holm for k in "xyz"] == pytest.approx(holm([made[k].p or 0.0 for k in "xyz"]))
    assert done["empty"].p_holm is None
    assert not done["x"].significant
    assert done["x"].mde == pytest.approx(100 * (detectable(50, 6, 0, 0.05 / 3) or 0.0), abs=1e-4)
    assert done["z"].mde is None


def compared(rows: list[dict[str, object]], a: str = "idm", b: str = "idm-e", seed: str = "c") -> Comparison:
    table = records(rows)
    names = np.array(table["planner"].to_pylist())
    extra = {name: pa.nulls(len(table), pa.string()) for name in ("violation_clause", "error")}
    for name, column in extra.items():
        table = table.append_column(name, column)
    return compare(*(table.filter(pa.array(names == planner)) for planner in (a, b)), seed=seed)


def test_errors_count_in_the_strict_figure_only() -> None:
    rows = [row("idm", map_id=f"m{k}") for k in range(10)]
    rows += [
        row("idm-e", map_id=f"m{k}", outcome="sim_error" if k < 2 else "arrived", **({"scd": False} if k < 2 else {}))
        for k in range(10)
    ]
    c = compared(rows)
    figure = c.primary.types["yield"]
    assert (figure.strict.value, figure.strict.n, figure.strict.lost) == (-20.0, 10, 2)
    assert (figure.completed.value, figure.completed.n) == (0.0, 8)
    assert (c.scenarios, c.completed, len(c.flips)) == (10, 8, 2)
    assert c.metrics["collision"].strict is None
    assert c.metrics["collision"].completed.n == 8


def test_a_comparison_agrees_with_its_records() -> None:
    c = compared(random_rows(("idm", "idm-e"), errors=0.05))
    assert list(c.primary.groups) == ["priority", "speed", "obstacles", "routing"]
    strict = [f.strict for f in c.primary.types.values() if f.strict is not None]
    assert c.primary.overall.strict.value == pytest.approx(np.mean([d.value for d in strict]))
    assert sum(f.won for f in c.flips) == sum(d.won or 0 for d in strict)
    assert sum(not f.won for f in c.flips) == sum(d.lost or 0 for d in strict)
    assert [f.won for f in c.flips] == sorted(f.won for f in c.flips)
    assert all(d.p_holm is not None and d.p is not None and d.p_holm >= d.p for d in strict)
    for figure in (c.primary.overall, *c.primary.groups.values(), *c.primary.types.values(), c.metrics["efficiency"]):
        for d in (figure.main, figure.completed):
            assert d.high is not None
            assert d.low <= d.value <= d.high
            assert d.significant == (d.mde is None)


def test_the_contract_seeds_the_draws_and_order_does_not_matter() -> None:
    rows = random_rows(("idm", "idm-e"))
    first = compared(rows)
    assert compared(rows[::-1]) == first
    other = compared(rows, seed="d")
    assert other.primary == first.primary
    mine, its = (c.metrics["efficiency"].completed for c in (first, other))
    assert replace(its, low=0, high=0, mde=0) == replace(mine, low=0, high=0, mde=0)
    assert its.low != mine.low


def test_scenarios_that_are_not_the_same_are_named() -> None:
    rows = [row("idm"), row("idm-e") | {"map_id": "elsewhere"}]
    with pytest.raises(InputError, match="scenario yield-m0-0: map_id is 'm0' in A and 'elsewhere' in B"):
        compared(rows)
