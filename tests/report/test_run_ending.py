"""What a run ends with and what `tsbench failures` lists: how many episodes failed and why, each with its sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from run_builders import episode, failed, lost, make_run, pairs

from tsbench.report.analyses.run_pool import read_pool
from tsbench.report.run_ending import GROUPINGS, citation, examples, failures_of, headline, listing
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.log.record import VIOLATIONS


def event(scenario: str, clause: str, sentence: str) -> dict[str, Any]:
    blank = {field.name: "" if str(field.type) == "string" else 0 for field in VIOLATIONS}
    given = {"planner": "idm", "scenario_id": scenario, "target": True, "clause": clause, "sentence": sentence}
    return blank | given


@pytest.fixture
def run(tmp_path: Path) -> StoredRun:
    end = {"scd": False, "duration_s": 60.0, "route_completion": 41.6}
    hit = {"collision_partner": "pedestrian", "at_fault": True}
    idm = [
        episode("idm", 0, 0, 0),
        episode("idm", 0, 1, 0, **lost("entered_while_blocked")),
        episode("idm", 0, 1, 1, **lost("entered_while_blocked") | {"outcome": "collision"}),
        episode("idm", 1, 0, 0, **end | {"outcome": "timeout", "sign_value": 20.0}),
        episode("idm", 1, 1, 0, **end | {"outcome": "off_road"}),
        episode("idm", 1, 2, 0, **end | hit | {"outcome": "collision"}),
    ]
    contrast = {"pair_id": "yield-m1-v0", "half": "contrast", "scenario_type": "main_road"}
    idm[2] |= contrast
    mine = [episode("mine", 0, 0, 0, **failed("ZeroDivisionError: division\nby zero"))]
    mine += [episode("mine", k, 3, v) for k, v in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 1))]
    told = [
        # Of one moment: what stands first in the table is not what the record names.
        event("yield-m1-v0", "contact", "At 7.0 s the ego touched convoy_0."),
        event("yield-m1-v0", "entered_while_blocked", f"At 7.0 s the ego had 3.1 m/s2 and {'a long way ' * 9}left."),
        event("yield-m1-v1", "entered_while_blocked", "At 6.0 s the ego entered."),
    ]
    return read_run(make_run(tmp_path / "my run", idm + mine, events=told))


def test_causes_are_counted_and_shown(run: StoredRun) -> None:
    assert list(examples(run)) == [
        "idm: 5 of 6 episodes failed: 2 entered_while_blocked, 1 timeout, 1 off_road, 1",
        "    collision",
        "  entered_while_blocked  idm/yield-m1-v0",
        "  timeout  idm/speed_limit-m0-v0",
        "  off_road  idm/speed_limit-m1-v0",
        "  collision  idm/speed_limit-m2-v0",
        "mine: 1 of 6 episodes failed: 1 error",
        "  error  yield-m0-v0: ZeroDivisionError: division by zero",
    ]


def test_an_exception_is_shown_first_however_rare(tmp_path: Path) -> None:
    rows = [episode("idm", 0, k, v, **lost(f"clause_{k}")) for k in range(6) for v in range(2)]
    make_run(tmp_path / "r", [*rows, episode("idm", 1, 0, 0, **failed("TypeError: no"))])
    shown = [line.split()[0] for line in examples(read_run(tmp_path / "r")) if line[2] != " " and line[0] == " "]
    assert shown == ["error", "clause_0", "clause_1", "clause_2", "clause_3"]


@pytest.mark.parametrize(("planners", "most"), [(1, 12), (4, 20), (10, 20), (20, 20), (21, 21)])
def test_failures_of_any_number_of_planners_fit_a_screen(tmp_path: Path, planners: int, most: int) -> None:
    causes = ("entered_while_blocked", "did_not_yield", "over_limit", "no_full_stop", "wrong_way", "entered")
    names = [f"planner{k}.py:{'Mine' * 4}" for k in range(planners)]
    rows = []
    for name in names:
        rows += [episode(name, 0, k, 0, **lost(cause)) for k, cause in enumerate(causes)]
        rows += [episode(name, 1, k, 0, **failed(f"ValueError: {'too long ' * 40}")) for k in range(2)]
    lines = list(examples(read_run(make_run(tmp_path / "r", rows))))
    assert len(lines) <= most
    assert max(map(len, lines)) <= 80
    heads = [line for line in lines if line[0] != " "]
    assert [head.split(": ")[0] for head in heads] == names
    assert all("8 of 8 episodes failed" in head for head in heads)
    assert ("  error  " in "\n".join(lines)) == (planners <= 10)


def test_every_failure_has_its_sentence(run: StoredRun) -> None:
    found = {failure.name: failure for failure in failures_of(run)}
    assert len(found) == 6
    assert found["idm/yield-m1-v0"].sentence.startswith("At 7.0 s the ego had 3.1 m/s² and")
    assert found["idm/yield-m1-v1"].type == "yield"
    assert found["idm/speed_limit-m0-v0"].plate == "2.4 (20)"
    assert {name: f.sentence for name, f in found.items() if "speed" in name} == {
        "idm/speed_limit-m0-v0": "At 60.0 s the time was up, after 42 % of its way.",
        "idm/speed_limit-m1-v0": "At 60.0 s the ego left the road, after 42 % of its way.",
        "idm/speed_limit-m2-v0": "At 60.0 s the ego touched a pedestrian (at fault), after 42 % of its way.",
    }
    assert found["mine/yield-m0-v0"].sentence == "ZeroDivisionError: division by zero"


def test_groups_of_a_list(run: StoredRun) -> None:
    found = failures_of(run)
    lines = {by: list(listing(run, found, by)) for by in GROUPINGS}
    counts = ["idm: 5 of 6 episodes failed: 2 entered_while_blocked, 1 timeout, 1 off_road, 1", "    collision"]
    counts += ["mine: 1 of 6 episodes failed: 1 error"]
    assert [told[:3] for told in lines.values()] == [counts] * 3
    heads = {by: [line for line in told[3:] if line[0] != " "] for by, told in lines.items()}
    assert heads["planner"] == ["idm: 5 of 6 failures", "mine: 1 of 6 failures"]
    assert heads["type"] == ["speed_limit: 3 of 6 failures", "yield: 3 of 6 failures"]
    assert [head.split(":")[0] for head in heads["clause"]] == [
        "entered_while_blocked", "timeout", "off_road", "collision", "error",
    ]  # fmt: skip


@pytest.mark.parametrize("by", GROUPINGS)
def test_a_list_has_all_failures_in_80_columns(run: StoredRun, by: str) -> None:
    found = failures_of(run)
    lines = list(listing(run, found, by))
    assert max(map(len, lines)) <= 80
    for failure in found:
        assert lines.count(f"  {failure.name}") == 1
    text = " ".join(" ".join(lines).split())
    assert "idm/yield-m1-v1 contrast 2.4, collision, entered_while_blocked: At 6.0 s the ego entered." in text
    assert "mine/yield-m0-v0 signed 2.4, planner_error, error: ZeroDivisionError: division by zero" in text


def test_what_to_cite_names_edition_selection_and_scoring(tmp_path: Path) -> None:
    make_run(tmp_path / "r", pairs("idm"))
    pool = read_pool([tmp_path / "r"], allow_partial=True)
    (line,), entry = citation(pool.runs[0], pool.summaries)
    effective, scoring = pool.runs[0].manifest["effective"], pool.runs[0].manifest.get("scoring", 1)
    figure = headline(pool.summaries)[1][0][1].replace(" (", " % (")
    assert line.startswith(f"idm: paired SCD {figure}, n = 48 (tsbench {pool.edition}, {effective['split']} split")
    assert line.endswith(f"scoring {scoring}, contract {pool.contract[:12]})")
    assert f"note    = {{edition {pool.edition}, scoring {scoring}}}" in entry
