"""Contrast pairs: paired, signed and contrast SCD, what a pair with a hole is, and places as clusters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table_builders import GROUPS, pair, records, row

from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import FLOOR, PlannerSummary, summarise
from tsbench.metrics.paired_differences import compare

Rows = list[dict[str, Any]]


def only(rows: Rows, **options: Any) -> PlannerSummary:
    asked = options.pop("asked", len(rows))
    return summarise(records(rows), contract_hash="c", asked={"idm": asked}, **options).planners[0]


def scd(p: PlannerSummary, part: str) -> tuple[float | None, int]:
    e = p.scores[part].overall.main
    return e.value, e.n


def four() -> Rows:
    """A pair of each kind: both halves passed, one of them, none."""
    told = [(True, True), (True, False), (False, True), (False, False)]
    return [r for k, (a, b) in enumerate(told) for r in pair(a, b, map_id=f"m{k}")]


def test_a_pair_is_passed_where_both_halves_are() -> None:
    p = only(four())
    assert list(p.scores) == ["paired_scd", "signed_scd", "contrast_scd"]
    assert p.primary is p.scores["paired_scd"]
    assert scd(p, "paired_scd") == (25.0, 4)
    assert scd(p, "signed_scd") == scd(p, "contrast_scd") == (50.0, 4)
    assert p.metrics["driving_score"].main.n == 8


def test_a_square_is_passed_where_both_its_pairs_are() -> None:
    """Reading one sign of two passes one pair, or one half of each."""
    told = [(True, True, True, True), (True, True, False, False), (True, False, True, False), (True, True, True, False)]
    rows = []
    for k, (a, b, c, d) in enumerate(told):
        second = [
            r | {name: r[name].replace(r["pair_id"], f"{r['pair_id']}b") for name in ("scenario_id", "pair_id")}
            for r in pair(c, d, map_id=f"m{k}")
        ]
        rows += [*pair(a, b, map_id=f"m{k}"), *second]
    p = only(rows)
    assert list(p.scores) == ["squared_scd", "paired_scd", "signed_scd", "contrast_scd"]
    assert scd(p, "squared_scd") == (25.0, 4)
    assert scd(p, "paired_scd") == (50.0, 8)


def test_what_passes_one_half_only_has_no_paired_scd() -> None:
    rows = [r for k in range(8) for r in pair(True, False, map_id=f"m{k}")]
    p = only(rows)
    assert (scd(p, "paired_scd")[0], scd(p, "signed_scd")[0], scd(p, "contrast_scd")[0]) == (0.0, 100.0, 0.0)


def test_paired_scd_is_over_the_types_that_have_pairs() -> None:
    rows = [*pair(kind="a", map_id="m0"), *pair(kind="a", contrast=False, map_id="m1"), *pair(kind="b")]
    rows += [row(kind="c", scd=False, map_id="m3")]
    p = only(rows)
    assert scd(p, "paired_scd") == (75.0, 3)
    assert set(p.scores["paired_scd"].types) == set(p.scores["contrast_scd"].types) == {"a", "b"}
    assert p.scores["paired_scd"].overall.main.parts == 2
    assert scd(p, "signed_scd") == (pytest.approx(200 / 3), 4)


def test_a_contrast_half_counts_for_the_type_of_its_pair() -> None:
    rows = [r for k in range(5) for r in pair(contrast_kind="main_road", map_id=f"m{k}")]
    p = only([*rows, row(kind="main_road", scd=False, map_id="m9")])
    assert set(p.scores["contrast_scd"].types) == {"yield"}
    assert p.scores["signed_scd"].types["main_road"].main.value == 0.0


def test_an_error_in_one_half_fails_the_pair_and_completes_no_pair() -> None:
    rows = [r for k in range(9) for r in pair(map_id=f"m{k}")]
    p = only([*rows, *pair(outcomes=("arrived", "sim_error"), map_id="m9")])
    figure = p.scores["paired_scd"].overall
    assert (figure.strict.value, figure.strict.n) == (90.0, 10)
    assert (figure.completed.value, figure.completed.n) == (100.0, 9)
    assert p.scores["signed_scd"].overall.completed.n == 10


def test_a_pair_without_one_half_is_a_hole_and_in_no_mean_of_pairs() -> None:
    rows = four()
    lacking = [r for r in rows if r["scenario_id"] != "yield-m1-0-c"]
    with pytest.raises(InputError, match="idm: 1 of 8"):
        only(lacking, asked=8)
    p = only(lacking, asked=8, allow_partial=True)
    assert scd(p, "paired_scd") == (pytest.approx(100 / 3), 3)
    assert scd(p, "signed_scd") == (50.0, 4)


@pytest.mark.parametrize(("half", "part"), [("signed", "signed_scd"), ("contrast", "contrast_scd")])
def test_one_half_alone_has_its_own_figure_only(half: str, part: str) -> None:
    p = only([r for r in four() if r["half"] == half])
    assert list(p.scores) == [part]
    assert scd(p, part) == (50.0, 4)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([pair()[0], pair()[1] | {"half": "signed"}], "has this half more than once"),
        ([pair()[0], pair()[1] | {"half": "left"}], "none of signed, contrast"),
        ([*pair(), row(map_id="m1") | {"pair_id": "yield-m0-0"}], "pair yield-m0-0 has this half more than once"),
    ],
)
def test_impossible_halves_are_named(rows: Rows, words: str) -> None:
    with pytest.raises(InputError, match=words):
        only(rows)


def random_pairs(seed: int, planner: str = "idm", errors: float = 0.1) -> Rows:
    """Pairs of four types, and rows of a fifth that has none."""
    rng = np.random.default_rng(seed)
    rows = [row(planner, kind="e", map_id=f"e{k}", scd=bool(rng.random() < 0.5)) for k in range(4)]
    for k in range(60):
        kind = int(rng.integers(4))
        outcomes = tuple("sim_error" if rng.random() < errors else "arrived" for _ in range(2))
        passed = rng.random(2) < 0.7
        made = pair(
            bool(passed[0]) and outcomes[0] == "arrived", bool(passed[1]) and outcomes[1] == "arrived",
            outcomes=(outcomes[0], outcomes[1]), planner=planner, kind="abcd"[kind], group=GROUPS[kind], map_id=f"m{k}",
        )  # fmt: skip
        rows += made
    return rows


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_no_more_pairs_are_passed_than_halves(seed: int) -> None:
    p = only(random_pairs(seed))
    paired = p.scores["paired_scd"]
    for kind, figure in paired.types.items():
        for part in ("signed_scd", "contrast_scd"):
            value = p.scores[part].types[kind].main.value
            assert figure.main.value <= value + 1e-9
    means = {part: np.mean([p.scores[part].types[kind].main.value for kind in paired.types]) for part in p.scores}
    assert paired.overall.main.value == pytest.approx(means["paired_scd"])
    assert means["paired_scd"] <= min(means["signed_scd"], means["contrast_scd"]) + 1e-9


def test_places_are_the_clusters_where_they_are_known() -> None:
    rows = [r for k in range(20) for r in pair(k % 2 == 0, map_id=f"m{k}", kind="roundabout")]
    known = [r | {"place": f"ring{int(r['map_id'][1:]) % 5}"} for r in rows]
    for part, n in (("paired_scd", 20), ("signed_scd", 20)):
        e = only(known).scores[part].overall.main
        assert (e.n, e.clusters) == (n, 5)
        assert e.low is not None
        assert only(rows).scores[part].overall.main.clusters == 20
    assert only(known).placed
    assert not only(rows).placed
    few = only([r | {"place": f"ring{int(r['map_id'][1:]) % 4}"} for r in rows]).primary.overall.main
    assert (few.low, few.reason) == (None, "only 4 places, fewer than 5")


def test_floors_are_marked() -> None:
    p = only(four(), marks={"idm": FLOOR})
    assert (p.floor, p.label) == (True, "idm (floor)")
    assert only(four()).label == "idm"


def told(rows: Rows) -> pa.Table:
    """Records with what flips are told by."""
    table = records(rows)
    for name in ("violation_clause", "error"):
        table = table.append_column(name, pa.nulls(len(table), pa.string()))
    return table


def test_a_comparison_tests_pairs_first() -> None:
    # B passes both halves where A passes one of them in turn.
    a = [r for k in range(12) for r in pair(k % 2 == 0, k % 2 == 1, planner="idm", map_id=f"m{k}")]
    b = [r for k in range(12) for r in pair(planner="idm-e", map_id=f"m{k}")]
    c = compare(told(a), told(b), seed="c")
    assert list(c.scores) == ["paired_scd", "signed_scd", "contrast_scd"]
    d = c.primary.overall.main
    assert (d.a, d.b, d.n, d.won, d.lost) == (0.0, 100.0, 12, 12, 0)
    assert d.p == pytest.approx(2 / 2**12)
    assert c.primary.types["yield"].main.p_holm == d.p
    halves = [c.scores[part].overall.main for part in ("signed_scd", "contrast_scd")]
    assert [(d.n, d.won, d.p) for d in halves] == [(12, 6, pytest.approx(2 / 2**6))] * 2
    assert {(f.half, f.won) for f in c.flips} == {("signed", True), ("contrast", True)}
    assert (c.scenarios, len(c.flips)) == (24, 12)
