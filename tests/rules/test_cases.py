from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from labelled import Judgement, Play, case_files, judge, play, read_case
from transform import Transform

from tsbench.rules.base import Violation
from tsbench.rules.registry import MONITORS
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S

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


def _summary(judged: Judgement) -> tuple[object, ...]:
    verdict = judged.verdict
    events = [(v.clause, v.start_s, v.end_s, v.other) for v in verdict.violations]
    return events, verdict.engaged, verdict.violating_steps, judged.completed_at


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_case_has_the_expected_verdict(path: Path) -> None:
    played = play(path)
    judged, expect = judge(played), played.case["expect"]
    verdict, steps = judged.verdict, set[int]()
    assert [v.clause for v in verdict.violations] == [e["clause"] for e in expect["events"]], verdict
    assert verdict.sign_id == played.scene.target
    assert verdict.engaged == expect["engaged"]
    assert verdict.compliant == (not expect["events"])
    for event, wanted in zip(verdict.violations, expect["events"], strict=True):
        assert event.start_s == pytest.approx(wanted["at"], abs=TIME_TOLERANCE_S)
        assert event.end_s == pytest.approx(wanted.get("until", wanted["at"]), abs=TIME_TOLERANCE_S)
        assert event.value == pytest.approx(wanted["value"], abs=wanted.get("tolerance", 0.01))
        assert event.threshold == pytest.approx(wanted["threshold"], abs=1e-6)
        assert event.other == wanted.get("other")
        _check_evidence(event, played, path.parent.name)
        steps |= set(range(round(event.start_s / DT_S), round(event.end_s / DT_S) + 1))
    assert verdict.violating_steps == expect.get("steps", len(steps))
    wanted_at = expect.get("completes")
    assert judged.completed_at == (
        wanted_at if wanted_at is None else pytest.approx(wanted_at, abs=TIME_TOLERANCE_S)
    )


def _check_evidence(event: Violation, played: Play, rule: str) -> None:
    """What an event says of itself follows from the plate, the clause and the tick at which it starts."""
    sign, ego = played.scene.target_sign, played.ticks[round(event.start_s / DT_S)].ego
    clause = load_catalog().rule(rule).clause(event.clause)
    assert (event.rule, event.sign_id, event.sign_code) == (rule, sign.id, sign.code)
    assert (event.x, event.y, event.heading, event.speed) == (ego.x, ego.y, ego.heading, ego.speed)
    assert event.margin == pytest.approx(abs(event.value - event.threshold))
    assert event.margin > 0.0
    assert event.unit == clause.unit
    assert event.sentence == clause.sentence(
        sign_code=sign.code, time_s=event.start_s, value=event.value, threshold=event.threshold,
        margin=event.margin, other=event.other,
    )  # fmt: skip


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_case_has_the_same_verdict_elsewhere(path: Path) -> None:
    here = judge(play(path))
    for name, view in VIEWS.items():
        there = judge(play(path, view))
        assert _summary(there) == _summary(here), name
        for a, b in zip(here.verdict.violations, there.verdict.violations, strict=True):
            assert abs(b.value) == pytest.approx(abs(a.value), abs=1e-6), name
            assert b.margin == pytest.approx(a.margin, abs=1e-6), name


def test_every_rule_has_six_cases_and_every_clause_one() -> None:
    cases = [(p.parent.name, read_case(p)) for p in FILES]
    count = Counter(rule for rule, _ in cases)
    broken = {(rule, e["clause"]) for rule, case in cases for e in case["expect"]["events"]}
    for rule in MONITORS:
        assert count[rule] >= 6, rule
        for clause in load_catalog().rule(rule).clauses:
            assert (rule, clause.id) in broken
