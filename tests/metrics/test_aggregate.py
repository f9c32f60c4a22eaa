"""Aggregation: strict and completed figures, holes, invariance, determinism."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table_builders import random_rows, records, row

from tsbench.core.benchmark import TYPES
from tsbench.core.errors import InputError
from tsbench.metrics.aggregate import PlannerSummary, Summary, summarise
from tsbench.signs.catalog import load_catalog


def summary(rows: list[dict[str, object]], asked: int | None = None, **options: bool) -> Summary:
    planners = sorted({str(r["planner"]) for r in rows})
    n = len(rows) // len(planners) if asked is None else asked
    return summarise(records(rows), contract_hash="c0ffee", asked=dict.fromkeys(planners, n), **options)


def only(rows: list[dict[str, object]], **options: bool) -> PlannerSummary:
    return summary(rows, **options).planners[0]


def test_the_number_of_types_is_the_catalogues() -> None:
    assert len(load_catalog().types) == TYPES


def test_macro_and_episode_weighted_means() -> None:
    # Type a: 1 of 2; type b (same group): 8 of 8; type c: 0 of 2.
    rows = [row(kind="a", map_id=f"a{k}", scd=k == 0) for k in range(2)]
    rows += [row(kind="b", map_id=f"b{k}") for k in range(8)]
    rows += [row(kind="c", group="speed", map_id=f"c{k}", scd=False) for k in range(2)]
    p = only(rows)
    assert {k: f.completed.value for k, f in p.primary.types.items()} == {"a": 50.0, "b": 100.0, "c": 0.0}
    assert {g: f.completed.value for g, f in p.primary.groups.items()} == {"priority": 75.0, "speed": 0.0}
    assert p.primary.overall.completed.value == 50.0
    assert p.primary.overall.completed.parts == 3
    assert p.metrics["driving_score"].completed.value == pytest.approx((9 * 100 + 3 * 50) / 12)
    assert p.primary.type_groups == {"a": "priority", "b": "priority", "c": "speed"}


def test_errors_are_failures_in_the_strict_figure() -> None:
    rows = [row(map_id=f"m{k}", outcome="sim_error" if k < 2 else "arrived") for k in range(10)]
    p = only(rows)
    assert (p.asked, p.recorded, p.completed) == (10, 10, 8)
    assert (p.primary.overall.strict.value, p.primary.overall.strict.n) == (80.0, 10)
    assert (p.primary.overall.completed.value, p.primary.overall.completed.n) == (100.0, 8)
    score = p.metrics["driving_score"]
    assert (score.strict.value, score.completed.value) == (80.0, 100.0)
    assert p.metrics["collision"].strict is None
    assert p.metrics["collision"].completed.n == 8
    assert p.outcomes["sim_error"] == 2


def test_nothing_but_errors() -> None:
    p = only([row(map_id=f"m{k}", outcome="planner_error") for k in range(6)])
    assert p.primary.overall.strict.value == 0.0
    assert p.primary.overall.completed.value is None
    assert p.metrics["comfort"].completed.reason == "no episode"


def test_efficiency_skips_what_does_not_apply() -> None:
    rows = [row(map_id=f"m{k}", efficiency=80.0 + 10 * k if k < 3 else None) for k in range(8)]
    figure = only(rows).metrics["efficiency"].completed
    assert (figure.value, figure.n, figure.low) == (90.0, 3, None)


def test_holes_are_refused() -> None:
    rows = [row(map_id=f"m{k}") for k in range(9)]
    with pytest.raises(InputError, match="idm: 1 of 10"):
        summary(rows, asked=10)
    partial = summary(rows, asked=10, allow_partial=True)
    assert partial.partial
    assert partial.title.startswith("PARTIAL, 1 episodes missing")
    assert not summary(rows).partial


def test_a_planner_without_any_record_is_a_hole() -> None:
    table = records([row(map_id=f"m{k}") for k in range(9)])
    with pytest.raises(InputError, match="other: 9 of 9"):
        summarise(table, contract_hash="c", asked={"idm": 9, "other": 9})


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([row(), row()], "recorded twice"),
        ([row(), row(planner="stranger")], "stranger"),
        ([row(), row(variant=1), row(variant=2)], "1 more than the 2"),
        ([row(outcome="sleeping"), row(variant=1)], "sleeping"),
        ([row(scd=None), row(variant=1)], "completed, but without"),  # type: ignore[arg-type]
    ],
)
def test_contradictions_are_named(rows: list[dict[str, object]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        summarise(records(rows), contract_hash="c", asked={"idm": 2})


def test_a_missing_column_is_named() -> None:
    with pytest.raises(InputError, match="no column scd"):
        summarise(records([row()]).drop_columns(["scd"]), contract_hash="c", asked={"idm": 1})


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_rows_does_not_matter(seed: int) -> None:
    rows = random_rows(("idm", "idm-e"), types=3, maps=6, variants=2, errors=0.1)
    table = records(rows)
    shuffled = table.take(pa.array(np.random.default_rng(seed).permutation(len(rows))))
    asked = {"idm": 36, "idm-e": 36}
    first = summarise(table, contract_hash="c", asked=asked).to_json()
    assert summarise(shuffled, contract_hash="c", asked=dict(reversed(asked.items()))).to_json() == first


def test_deterministic_for_a_contract_and_different_for_another() -> None:
    table = records(random_rows())
    texts = [summarise(table, contract_hash=c, asked={"idm": 144}).to_json() for c in ("a", "a", "b")]
    assert texts[0] == texts[1]
    speeds = [json.loads(t)["planners"][0]["metrics"]["efficiency"]["completed"] for t in texts]
    assert speeds[0]["value"] == speeds[2]["value"]
    assert speeds[0]["low"] != speeds[2]["low"]


def test_a_planner_scores_the_same_in_any_company() -> None:
    alone = only(random_rows(("idm",)))
    rows = random_rows(("idm",)) + [r | {"planner": "z"} for r in random_rows(("idm",), seed=5)]
    assert summary(rows).planners[0] == alone


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000), st.floats(0.0, 0.5))
def test_figures_hold_together(seed: int, errors: float) -> None:
    p = only(random_rows(types=4, maps=5, variants=2, errors=errors, seed=seed))
    for figure in (p.primary.overall, *p.primary.groups.values(), *p.primary.types.values(), *p.metrics.values()):
        for e in (figure.strict, figure.completed):
            if e is None or e.value is None or e.low is None or e.high is None:
                continue
            assert e.low <= e.value + 1e-6
            assert e.value <= e.high + 1e-6
        if figure.strict is not None and figure.completed.n:
            assert figure.strict.n >= figure.completed.n
    kinds = [f.strict.value for f in p.primary.types.values() if f.strict is not None]
    assert p.primary.overall.strict.value == pytest.approx(np.mean([k for k in kinds if k is not None]))


def test_json_has_a_stable_order_and_no_nan() -> None:
    text = summary(random_rows(errors=0.05)).to_json()
    content = json.loads(text, parse_constant=lambda c: pytest.fail(c))
    assert list(content)[:3] == ["schema", "title", "contract_hash"]
    assert list(content["planners"][0]["scores"]) == ["signed_scd"]
    assert list(content["planners"][0]["scores"]["signed_scd"]["groups"]) == [
        "priority",
        "speed",
        "obstacles",
        "routing",
    ]
