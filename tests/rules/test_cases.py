from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from labelled import case_files, completion, judge, read_case
from transform import Transform

from tsbench.rules.base import Verdict
from tsbench.rules.registry import MONITORS
from tsbench.signs.catalog import load_catalog

VIEWS = {
    "mirrored": Transform(mirror=True),
    "turned": Transform(angle=0.7, dx=1234.5, dy=-987.25),
    "turned_back": Transform(angle=-2.9, dx=-51.0, dy=7.5),
    "mirrored_and_turned": Transform(mirror=True, angle=1.9, dx=400.0, dy=80.0),
}
FILES = case_files()
TIME_TOLERANCE_S = 0.051


def _name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def _summary(verdict: Verdict) -> list[tuple[str, float, float, str | None]]:
    return [(v.clause, v.start_s, v.end_s, v.other) for v in verdict.violations]


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_case_has_the_expected_verdict(path: Path) -> None:
    case = read_case(path)
    verdict, expect = judge(case), case["expect"]
    assert [v.clause for v in verdict.violations] == [e["clause"] for e in expect["events"]], verdict
    assert verdict.engaged == expect["engaged"]
    assert verdict.compliant == (not expect["events"])
    for event, wanted in zip(verdict.violations, expect["events"], strict=True):
        assert event.start_s == pytest.approx(wanted["at"], abs=TIME_TOLERANCE_S)
        if "until" in wanted:
            assert event.end_s == pytest.approx(wanted["until"], abs=TIME_TOLERANCE_S)
        if "value" in wanted:
            assert event.value == pytest.approx(wanted["value"], abs=wanted.get("tolerance", 0.01))
        assert event.other == wanted.get("other")
        assert event.margin > 0.0
        assert case["signs"][0]["code"] in event.sentence
    if "steps" in expect:
        assert verdict.violating_steps == expect["steps"]
    wanted_at = expect.get("completes")
    assert completion(case) == (
        wanted_at if wanted_at is None else pytest.approx(wanted_at, abs=TIME_TOLERANCE_S)
    )


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("path", FILES, ids=_name)
def test_case_has_the_same_verdict_elsewhere(path: Path, view: str) -> None:
    case = read_case(path)
    here, there = judge(case), judge(case, VIEWS[view])
    assert _summary(there) == _summary(here)
    assert (there.engaged, there.violating_steps) == (here.engaged, here.violating_steps)
    assert completion(case, VIEWS[view]) == completion(case)
    for a, b in zip(here.violations, there.violations, strict=True):
        assert abs(b.value) == pytest.approx(abs(a.value), abs=1e-6)
        assert b.margin == pytest.approx(a.margin, abs=1e-6)


def test_every_rule_has_six_cases_and_every_clause_one() -> None:
    cases = [(p.parent.name, read_case(p)) for p in FILES]
    count = Counter(rule for rule, _ in cases)
    broken = {(rule, e["clause"]) for rule, case in cases for e in case["expect"]["events"]}
    for rule in MONITORS:
        assert count[rule] >= 6, rule
        for clause in load_catalog().rule(rule).clauses:
            assert (rule, clause.id) in broken
