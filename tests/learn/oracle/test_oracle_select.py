"""The choice among successful drives, and what the table then holds."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.learn.imitation.recipe import kept_for_validation
from tsbench.learn.oracle.select import Candidate, f_score, part_of, rank, select, stats
from tsbench.learn.oracle.store import KIND, Collection, basis, read_tries
from tsbench.learn.oracle.trajectories import FIGURES, pack, stream_trajectories, unpack
from tsbench.report.analyses.analysis import to_csv, write_analysis
from tsbench.run.log.manifest import new_manifest
from tsbench.run.log.record import Record, Row, error_row
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

PLANNERS = [
    PlannerInfo("idm-e", "idm-e", True, True, (), None, "c"),
    PlannerInfo("idm-s4-e", "idm-s4-e", True, True, (), None, "c"),
    PlannerInfo("net-e", "net-e", True, True, (), "w", "c"),
]


def collection(
    folder: Path, table: list[ScenarioSpec], planners: list[PlannerInfo] = PLANNERS, redrive: bool = False
) -> Collection:
    effective = {"collection": KIND, "split": "train", "tries": 4}
    manifest = new_manifest(basis(DataSet()), {}, effective, planners)
    return Collection(folder, manifest, table, planners, redrive)


def line(planner: str, spec: ScenarioSpec, *steps: int, comfort: float = 0.5) -> Record:
    """Tries of an expert on a scenario; the last one succeeded, unless it took 0 steps."""
    tries: list[Row] = []
    for number, count in enumerate(steps):
        last = number == len(steps) - 1 and count > 0
        figures: Row = dict.fromkeys(FIGURES) | {"compliant": last, "engaged": True, "mean_speed": 5.0}
        figures |= {"steps": count, "comfort": comfort, "ego": f"{count:016x}", "others": f"{number:016x}"}
        outcome = "arrived" if last else "timeout"
        tries.append({"attempt": number, "outcome": outcome, "error": None, "scd": last, **figures})
    done = tries[-1]["scd"]
    row = {
        "planner": planner, "scenario_id": spec.scenario_id, "outcome": tries[-1]["outcome"], "error": None,
        "scd": done, "tries": tries,
        "commands": pack(np.full((steps[-1], 2), len(planner), dtype=np.int16)) if done else None,
        "intents": [[3, ["a", "b"]], [7, []]] if done else None,
    }  # fmt: skip
    return Record(row, [], {}, "")


@pytest.fixture
def full(tmp_path: Path, rows: list[ScenarioSpec]) -> Path:
    """A collection `c` of three scenarios: two experts of the IDM kind and a network; the network's own; nobody's."""
    table = rows[:3]
    with closing(collection(tmp_path / "c", table)) as made:
        for record in (
            line("net-e", table[0], 100, comfort=0.9), line("idm-e", table[0], 120, comfort=0.9),
            line("idm-s4-e", table[0], 0, 90, comfort=0.8), line("net-e", table[1], 200), line("idm-e", table[1], 0),
            line("idm-s4-e", table[1], 0, 0), line("idm-e", table[2], 0), line("idm-s4-e", table[2], 0, 0),
            line("net-e", table[2], 0),
        ):  # fmt: skip
            made.keep(record)
        made.end(complete=True)
    return tmp_path


shares = st.floats(0.0, 1.0)
candidates = st.lists(
    st.builds(
        Candidate, st.sampled_from([f"expert-{k}" for k in range(8)]), st.booleans(), st.integers(20, 600), shares,
        st.just({}),
    ),
    max_size=8, unique_by=lambda c: c.planner,
)  # fmt: skip


def test_f_score_by_hand() -> None:
    assert f_score(1.0, 1.0) == pytest.approx(1.0)
    assert f_score(0.5, 0.8) == pytest.approx(1.0625 * 0.4 / (0.03125 + 0.8))
    assert f_score(0.0, 0.0) == 0.0


@given(shares, shares, shares)
def test_f_score_lies_between_and_grows(v: float, s: float, more: float) -> None:
    q = f_score(v, s)
    assert min(v, s) - 1e-9 <= q <= max(v, s) + 1e-9
    assert f_score(max(v, more), s) >= q - 1e-9
    assert f_score(v, max(s, more)) >= q - 1e-9
    high, low = max(v, s), min(v, s)
    assert f_score(high, low) >= f_score(low, high) - 1e-9


@given(candidates, st.randoms(use_true_random=False))
def test_the_drives_that_count_in_order(found: list[Candidate], random: Any) -> None:
    best = rank(found)
    assert len(best) == sum(not c.rules for c in found) + any(c.rules for c in found)
    assert [q for _, q in best] == sorted((q for _, q in best), reverse=True)
    rules = [c for c, _ in best if c.rules]
    assert len(rules) <= 1
    for c in rules:
        assert c.steps == min(other.steps for other in found if other.rules)
    fastest = min((c.steps for c in found), default=0)
    assert all(q == f_score(fastest / c.steps, c.comfort) for c, q in best)
    shuffled = list(found)
    random.shuffle(shuffled)
    assert rank(shuffled) == best


@given(st.lists(st.tuples(st.integers(-6000, 3000), st.integers(-6981, 6981)), min_size=1, max_size=50))
def test_commands_come_back_from_a_line(pairs: list[tuple[int, int]]) -> None:
    commands = np.array(pairs, dtype=np.int16)
    assert unpack(pack(commands)).tolist() == commands.tolist()


def test_a_fifth_of_the_maps_is_for_validation(rows: list[ScenarioSpec]) -> None:
    maps = {row.map_id: row for row in rows}
    parts = {name: part_of(row) for name, row in maps.items()}
    assert {part_of(row) == parts[row.map_id] for row in rows} == {True}
    assert all(parts[name] == "validation" for name, row in maps.items() if kept_for_validation(row))
    share = sum(part == "validation" for part in parts.values()) / len(parts)
    assert share == pytest.approx(0.2, abs=4 * (0.16 / len(parts)) ** 0.5)


def test_select_writes_the_best_drives(full: Path, rows: list[ScenarioSpec]) -> None:
    found = select(DataSet(), full / "c", full / "oracle.parquet", allow_partial=False)
    assert (found.scenarios, found.covered, found.drives) == (3, 2, 3)
    assert found.uncovered == {rows[2].scenario_type: 1}
    first, second, third = stream_trajectories(full / "oracle.parquet")
    assert (first.planner, first.rank, first.attempt) == ("idm-s4-e", 1, 1)
    assert first.quality == pytest.approx(f_score(1.0, 0.8))
    assert (second.planner, second.rank) == ("net-e", 2)
    assert second.quality == pytest.approx(f_score(0.9, 0.9))
    assert (third.planner, third.rank, third.scenario_id) == ("net-e", 1, rows[1].scenario_id)
    assert third.commands.tolist() == [[5, 5]] * 200
    assert third.intents == ((3, ("a", "b")), (7, ()))
    assert first.part == part_of(rows[0])


def test_a_third_drive_is_kept_and_not_chosen(tmp_path: Path, rows: list[ScenarioSpec]) -> None:
    third = replace(PLANNERS[2], name="other-e")
    with closing(collection(tmp_path / "c", rows[:1], [*PLANNERS, third])) as made:
        for name, steps in (("idm-e", 100), ("net-e", 110), ("other-e", 120)):
            made.keep(line(name, rows[0], steps))
        made.end(complete=True)
    found = select(DataSet(), tmp_path / "c", tmp_path / "oracle.parquet", allow_partial=False)
    assert (found.drives, found.others) == (2, 1)
    assert [(d.planner, d.rank) for d in stream_trajectories(tmp_path / "oracle.parquet")] == [
        ("other-e", 0), ("idm-e", 1), ("net-e", 2),
    ]  # fmt: skip
    assert stats(DataSet(), tmp_path / "oracle.parquet", "train").table.rows[0].cells[2] == 2


def test_tries_are_one_row_each_in_order(full: Path) -> None:
    tries = read_tries(full / "c")
    assert len(tries) == 12
    keys = [(t["planner"], t["scenario_id"], t["attempt"]) for t in tries]
    assert keys == sorted(keys)
    assert [t["kind"] for t in tries if t["planner"] == "net-e"] == ["learned"] * 3
    assert tries[0]["duration_s"] == 12.0


def test_a_collection_grows_and_forgets_what_has_changed(full: Path, rows: list[ScenarioSpec]) -> None:
    newer = replace(PLANNERS[2], weights_sha256="other weights")
    table = [replace(rows[0], seed=rows[0].seed + 1), *rows[1:5]]
    more = [PLANNERS[0], replace(newer, name="carl-e"), newer]
    with closing(collection(full / "c", table, more)) as made:
        kept = set(made.journal.done)
        assert kept == {(p, r.scenario_id) for r in rows[1:3] for p in ("idm-e", "idm-s4-e")}
        assert len(made.notices) == 1
        assert "5 of a scenario or an expert that has changed" in made.notices[0]
        made.keep(line("carl-e", rows[4], 50))
        made.end(complete=False)
    assert {p["name"] for p in made.manifest["planners"]} == {"idm-e", "idm-s4-e", "net-e", "carl-e"}
    assert len(read_tries(full / "c")) == 7


def test_other_code_of_an_expert_is_told_and_voids_nothing(full: Path, rows: list[ScenarioSpec]) -> None:
    other = [replace(PLANNERS[0], code_sha256="other"), *PLANNERS[1:]]
    with closing(collection(full / "c", rows[:3], other)) as made:
        assert len(made.journal.done) == 9
        assert [line.partition(": ")[2] for line in made.notices] == [
            "3 lines were driven by other code of idm-e: tsbench oracle verify proves them, --redrive drives them again"
        ]
    with closing(collection(full / "c", rows[:3], other, redrive=True)) as made:
        assert {planner for planner, _ in made.journal.done} == {"idm-s4-e", "net-e"}


@pytest.mark.parametrize("what", ["unfinished", "contract", "rows", "journal", "nothing", "run"])
def test_select_refuses_in_one_line(full: Path, rows: list[ScenarioSpec], what: str) -> None:
    folder, told = full / "c", ""
    manifest = folder / "run.json"
    text = manifest.read_text()
    if what == "unfinished":
        manifest.write_text(text.replace('"complete"', '"interrupted"'))
        told = "is not finished"
    elif what == "contract":
        manifest.write_text(text.replace(basis(DataSet()), "0" * 64))
        told = "was collected with other rules or another SUMO"
    elif what == "rows":
        with closing(collection(folder, [replace(rows[0], seed=1)])) as made:
            made.keep(line("idm-e", rows[0], 9))
            made.end(complete=True)
        told = f"scenario {rows[0].scenario_id} has changed since"
    elif what == "journal":
        (folder / "journal.jsonl").write_bytes(b"")
        told = "3 drives of its table are not in its journal"
    elif what == "nothing":
        folder, told = full / "none", "no collection"
    else:
        manifest.write_text(text.replace('"collection"', '"other"'))
        told = "not the manifest of a tsbench run"
    with pytest.raises(InputError, match=told):
        select(DataSet(), folder, full / "oracle.parquet", allow_partial=False)


def test_stats_of_the_chosen_drives(full: Path, rows: list[ScenarioSpec]) -> None:
    select(DataSet(), full / "c", full / "oracle.parquet", allow_partial=False)
    analysis = stats(DataSet(), full / "oracle.parquet", "train")
    cells = {row.cells[:2]: row.cells[2:] for row in analysis.table.rows}
    drives, share, first, hours, scenarios, covered, coverage, per = cells["all types", "all experts"]
    assert (drives, share, first, scenarios, covered) == (3, 100.0, 2, len(rows), 2)
    assert hours == pytest.approx((90 + 100 + 200) / 36000)
    assert coverage == pytest.approx(200 / len(rows))
    assert per == pytest.approx(3 / len(rows))
    assert list(cells["all types", "net-e"][:3]) == [2, pytest.approx(200 / 3), 1]
    assert cells["all types", "published"][0] == 36828
    assert to_csv(analysis).startswith("group,planner,drives,share,")
    assert [p.suffix for p in write_analysis(analysis, full)] == [".csv", ".tex", ".md", ".png", ".svg"]


def test_a_drive_that_took_its_worker_along_is_a_try(tmp_path: Path, rows: list[ScenarioSpec]) -> None:
    row = error_row(rows[0], "idm-e", True, Outcome.SIM_ERROR, "the worker process ended: SIGSEGV")
    with closing(collection(tmp_path / "c", rows[:1])) as made:
        made.keep(Record(row, [], {}, "the whole story"))
        made.end(complete=True)
    (one,) = read_tries(tmp_path / "c")
    assert (one["scd"], one["outcome"], one["steps"]) == (False, "sim_error", None)
    assert one["error"] == "the worker process ended: SIGSEGV"
    (story,) = (tmp_path / "c" / "errors").rglob("*.txt")
    assert story.read_text() == "the whole story\n"
    assert select(DataSet(), tmp_path / "c", tmp_path / "oracle.parquet", allow_partial=False).covered == 0
