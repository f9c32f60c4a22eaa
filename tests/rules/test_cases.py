from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from labelled import Judgement, Play, Spec, case_files, judge, play, read_case
from transform import Transform

from tsbench.rules.monitor import Violation
from tsbench.rules.monitors import MONITORS, NEEDLESS
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S

VIEWS = {
    "turned": Transform(angle=0.7, dx=1234.5, dy=-987.25),
    "mirrored_and_turned_back": Transform(mirror=True, angle=-2.9, dx=-51.0, dy=7.5),
}
FILES = case_files()
# Rules that hold along a stretch of road, which may be broken, kept and broken again.
ZONES = ("speed", "min_speed", "reserved_lane")
TIME_TOLERANCE_S = 0.051


def _name(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def _summary(judged: Judgement) -> tuple[object, ...]:
    verdict = judged.verdict
    events = [(v.clause, v.start_s, v.end_s, v.other) for v in verdict.violations]
    return events, verdict.engaged, verdict.violating_steps, judged.completed_at


@pytest.mark.parametrize("path", FILES, ids=_name)
def test_case_has_the_expected_verdict_here_and_elsewhere(path: Path) -> None:
    played = play(path)
    judged, expect = judge(played), played.case["expect"]
    verdict, steps = judged.verdict, set[int]()
    assert [v.clause for v in verdict.violations] == [e["clause"] for e in expect["events"]], verdict
    assert verdict.sign_id == played.scene.targets[0]
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
    engaged, before, after = judged.so_far
    assert sorted(after) == sorted(v.clause for v in verdict.violations)
    assert Counter(before) <= Counter(after)
    assert verdict.engaged == (engaged or bool(after))
    wanted_at = expect.get("completes")
    assert judged.completed_at == (wanted_at if wanted_at is None else pytest.approx(wanted_at, abs=TIME_TOLERANCE_S))
    for name, view in VIEWS.items():
        there = judge(play(path, view))
        assert _summary(there) == _summary(judged), name
        for a, b in zip(verdict.violations, there.verdict.violations, strict=True):
            assert abs(b.value) == pytest.approx(abs(a.value), abs=1e-6), name
            assert b.margin == pytest.approx(a.margin, abs=1e-6), name


def _check_evidence(event: Violation, played: Play, rule: str) -> None:
    """What an event says of itself follows from the plate, the clause and the tick at which it starts."""
    sign, ego = played.scene.target_signs[0], played.ticks[round(event.start_s / DT_S)].ego
    catalog = load_catalog()
    of_no_plate = {"wrong_way": catalog.wrong_way} | dict.fromkeys(NEEDLESS, catalog.needless)
    kind = of_no_plate.get(rule) or catalog.rule(rule)
    clause = kind.clause(event.clause)
    assert (event.rule, event.sign_id, event.sign_code) == (kind.name, sign.id, sign.code)
    assert (event.x, event.y, event.heading, event.speed) == (ego.x, ego.y, ego.heading, ego.speed)
    assert event.margin == pytest.approx(abs(event.value - event.threshold))
    assert event.margin > 0.0
    assert event.unit == clause.unit
    assert event.sentence == clause.sentence(
        sign_code=sign.code, time_s=event.start_s, value=event.value, threshold=event.threshold,
        margin=event.margin, other=event.other,
    )  # fmt: skip


@dataclass
class Shown:
    """What the cases of one type show: how many there are, `shows`, kinds of verdict, clauses, clauses twice."""

    count: int = 0
    kinds: set[str] = field(default_factory=set)
    clauses: set[str] = field(default_factory=set)
    twice: set[str] = field(default_factory=set)

    def add(self, case: Spec) -> None:
        """Count one case."""
        clauses = Counter(e["clause"] for e in case["expect"]["events"])
        self.count += 1
        self.kinds.add(case.get("shows", ""))
        self.kinds.add("violation" if clauses else "pass" if case["expect"]["engaged"] else "not engaged")
        self.clauses |= set(clauses)
        self.twice |= {clause for clause, events in clauses.items() if events > 1}


def _by_type() -> dict[str, Shown]:
    """By scenario type; a case whose mirror image has another plate counts for that plate's type too."""
    shown: dict[str, Shown] = defaultdict(Shown)
    for case in (read_case(path) for path in FILES if path.parent.name in MONITORS):
        codes = {case["signs"][0]["code"], case.get("mirrored", case["signs"][0]["code"])}
        for type_id in {load_catalog().sign(code).type_id for code in codes}:
            shown[type_id].add(case)
    return shown


def test_every_type_is_shown_from_all_sides() -> None:
    catalog, shown = load_catalog(), _by_type()
    assert len(catalog.types) == 29
    for kind in catalog.types:
        rule, seen = catalog.sign(kind.codes[0]).rule, shown[kind.id]
        wanted = {c.id for c in rule.clauses}
        if len(rule.options.get("allowed_sides", ())) == 2:
            wanted.remove("wrong_side")  # both are right
        assert seen.count >= 6, kind.id
        assert seen.kinds >= {"pass", "violation", "not engaged", "inside", "outside", "elsewhere"}, kind.id
        assert seen.clauses == wanted, kind.id
        if rule.name in ZONES:
            assert seen.twice & wanted, kind.id


def test_every_rule_has_cases() -> None:
    assert {path.parent.name for path in FILES} == {*MONITORS, *NEEDLESS, "wrong_way"}
    assert set(MONITORS) == set(load_catalog().rules)


@pytest.mark.parametrize("clause", [*NEEDLESS, "wrong_way"])
def test_every_clause_of_no_plate_is_shown_from_all_sides(clause: str) -> None:
    shown = Shown()
    for case in (read_case(path) for path in FILES if path.parent.name == clause):
        assert set(case.get("contrast", {case.get("watches")})) == {clause}
        shown.add(case)
    assert shown.count >= 6
    assert shown.kinds >= {"not engaged", "violation", "inside", "outside", "elsewhere"}
    assert shown.clauses == {clause}
