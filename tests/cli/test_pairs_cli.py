"""Contrast pairs in `tsbench analyse` and `compare`: which figure comes first, halves apart, floors, older runs."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import episode_builders as made
import pyarrow.parquet as pq
import pytest
from command_line import Command, in_process
from run_builders import episode, episodes, failed, lost, make_run, pairs

from tsbench.metrics.scd import CONTRASTED, PAIRED, SIGNED_ONES
from tsbench.report.analyses.analysis import write_analysis
from tsbench.report.analyses.run_analyses import OF_POOL, analyse_runs
from tsbench.run.log.journal import file_hashes
from tsbench.run.log.read import read_run
from tsbench.run.log.record import LATER

Table = Callable[..., list[dict[str, str]]]


@pytest.fixture
def table(tmp_path: Path, analyse: Command) -> Table:
    """The table of an analysis of runs as rows of its CSV."""

    def table(name: str, *runs: str) -> list[dict[str, str]]:
        analyse(name, *runs, "--out", "out")
        with (tmp_path / "out" / f"{name}.csv").open(encoding="utf-8") as file:
            return list(csv.DictReader(file))

    return table


NEEDLESS = lost("needless_slow") | {"violations": 1}


def three(folder: Path, **effective: object) -> Path:
    """`blind`, a floor, fails all contrast halves; idm one signed and one other contrast half; idm-e none.

    48 pairs of each.
    """
    every = {f"speed_limit_m{m}_v{v}_c": NEEDLESS for m in range(6) for v in range(4)}
    every |= {f"yield_m{m}_v{v}_c": lost() for m in range(6) for v in range(4)}
    rows = pairs("blind", **every)
    rows += pairs("idm", yield_m0_v0=lost(), speed_limit_m1_v1_c=NEEDLESS)
    rows += pairs("idm-e")
    event = asdict(made.violation(3.0, clause="needless_slow"))
    events = [
        {"planner": "idm", "scenario_id": "speed_limit-m1-v1-c", "number": k, "target": True, **event} for k in range(2)
    ]
    return make_run(folder, rows, events=events, floors=("blind",), **effective)


def number(text: str) -> float:
    return round(float(text), 3)


ONE_LOST = round(100 * 23 / 24, 3)


def test_paired_comes_first_in_the_main_table(table, tmp_path: Path) -> None:
    three(tmp_path / "r")
    rows = {row["planner"]: row for row in table("main", "r") if row["figure"] == "strict"}
    heads = [key for key in rows["idm"] if key.endswith("overall")]
    assert heads == [f"{part}_overall" for part in (PAIRED, SIGNED_ONES, CONTRASTED)]
    assert next(iter(row for row in rows["idm"] if "scd" in row)) == "paired_scd_overall"
    assert set(rows) == {"blind (floor)", "idm", "idm-e"}
    assert [number(rows["idm"][head]) for head in heads] == [ONE_LOST, round(100 * 47 / 48, 3), round(100 * 47 / 48, 3)]
    assert [number(rows["blind (floor)"][head]) for head in heads] == [0.0, 100.0, 0.0]
    assert (rows["idm"]["n"], rows["idm"]["paired_scd_overall_n"]) == ("96", "48")


def test_types_have_three_figures_by_the_pairs_type(table, tmp_path: Path) -> None:
    three(tmp_path / "r")
    rows = table("types", "r")
    names = [(row["type"], row["score"]) for row in rows]
    scores = ["paired SCD", "signed SCD", "contrast SCD"]
    assert names == [(kind, score) for kind in ("yield", "speed_limit") for score in scores]
    assert [number(row["idm"]) for row in rows] == [ONE_LOST, ONE_LOST, 100.0, ONE_LOST, 100.0, ONE_LOST]


def test_failures_of_each_half_name_needless_obedience(table, tmp_path: Path) -> None:
    three(tmp_path / "r")
    rows = {(r["planner"], r["group"], r["half"]): r for r in table("failures", "r")}
    signed, contrast = (rows["idm", "all types", half] for half in ("signed", "contrast"))
    for half in (signed, contrast):
        assert (half["n"], number(half["violated_arrived"])) == ("48", round(100 / 48, 3))
    # Two events of one episode are one episode.
    assert (number(contrast["needless_slow"]), number(contrast["needless_stop"])) == (round(100 / 48, 3), 0.0)
    assert signed["needless_slow"] == ""
    assert number(rows["blind (floor)", "priority", "contrast"]["violated_arrived"]) == 100.0


def test_the_floor_stands_below_the_planners(table, tmp_path: Path) -> None:
    three(tmp_path / "r")
    rows = table("floor", "r")
    assert [row["over"] for row in rows] == ["all"] * 3 + ["group"] * 6 + ["type"] * 6
    assert [row["planner"] for row in rows[:3]] == ["idm", "idm-e", "blind (floor)"]
    blind = rows[2]
    assert [number(blind[part]) for part in (PAIRED, SIGNED_ONES, CONTRASTED)] == [0.0, 100.0, 0.0]
    assert blind["paired_scd_high"] != ""
    assert (blind["n"], blind["places"]) == ("48", "12")
    note = (tmp_path / "out" / "floor.md").read_text(encoding="utf-8")
    assert "floor: blind read no plate." in note


def test_whose_work_a_planner_is_stands_behind_its_name(table, tmp_path: Path) -> None:
    rows = pairs("idm") + pairs("pdm") + pairs("metadrive-ppo")
    make_run(tmp_path / "r", rows)
    told = [row["planner"] for row in table("floor", "r")[:3]]
    assert told == ["idm", "metadrive-ppo (third-party)", "pdm (reimplemented)"]


def test_an_ablation_is_of_pairs_first(table, tmp_path: Path) -> None:
    make_run(tmp_path / "plain", pairs("idm-e"))
    make_run(tmp_path / "masked", pairs("idm-e", yield_m0_v0_c=lost()), mask_signs=True)
    rows = table("ablation", "plain", "masked")
    assert [rows[k]["metric"] for k in (0, 3, 6)] == [
        "paired SCD, all types", "signed SCD, all types", "contrast SCD, all types",
    ]  # fmt: skip
    assert [(rows[k]["n"], rows[k]["lost"]) for k in (0, 3, 6)] == [("48", "1"), ("48", "0"), ("48", "1")]


def test_half_a_pair_without_a_record_is_a_hole(tmp_path: Path) -> None:
    rows = pairs("idm", yield_m0_v0=failed("boom"))
    make_run(tmp_path / "part", [row for row in rows if row["scenario_id"] != "yield-m1-v0-c"], asked=96)
    analysis = analyse_runs("intervals", [tmp_path / "part"], allow_partial=True)
    assert analysis.title.startswith("PARTIAL, 1 episodes missing: ")
    first, second = analysis.table.rows[:2]
    assert (first.cells[2:4], first.cells[5]) == (("paired SCD", "strict"), 47)
    assert (second.cells[3], second.cells[5]) == ("completed", 46)


def test_compare_tests_pairs_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    three(tmp_path / "r")
    out, _ = in_process("compare", capsys)("r:blind", "r:idm", "--png", "forest.png")
    assert out.startswith("A blind (r, floor), B idm (r): 96 paired scenarios\n")
    heads = [out.index(f"{name} SCD\n") for name in ("Signed", "Contrast")]
    assert out.index("paired SCD") < heads[0] < heads[1] < out.index("Metrics\n")
    first = next(line.split() for line in out.splitlines() if line.startswith("all"))
    # 48 pairs: idm passes 46 of them, the floor none.
    assert (first[-1], first[-2], first[-3]) == ("48", "46", "0")
    assert (tmp_path / "forest.png").is_file()


@pytest.mark.parametrize("kind", ["types", "failures"])
def test_figures_of_pairs_are_drawn(tmp_path: Path, kind: str) -> None:
    analysis = analyse_runs(kind, [three(tmp_path / "r")], allow_partial=False)
    assert [path.suffix for path in write_analysis(analysis, tmp_path / "out")][-2:] == [".png", ".svg"]


def test_a_run_from_before_pairs_reads_as_signed_rows(tmp_path: Path) -> None:
    run = make_run(tmp_path / "old", episodes("idm", yield_m0_v0=lost()))
    table = pq.read_table(run / "episodes.parquet")
    pq.write_table(table.drop_columns(list(LATER)), run / "episodes.parquet")
    manifest = json.loads((run / "run.json").read_text())
    for planner in manifest["planners"]:
        del planner["floor"]
    (run / "run.json").write_text(json.dumps(manifest | {"files": file_hashes(run)}))
    stored = read_run(run).episodes
    assert {name: set(stored[name].to_pylist()) for name in LATER} == {name: {value} for name, value in LATER.items()}
    for name in OF_POOL.keys() - {"correlations"}:
        assert analyse_runs(name, [run], allow_partial=False).table.rows


@pytest.mark.parametrize(
    ("type_id", "said", "share"),
    [
        ("limit_and_yield", ("give_way", "encroached", "2.4"), (0.0, 25.0)),
        ("limit_and_yield", ("speed", "speeding", "3.24"), (25.0, 0.0)),
        ("limit_in_zone", ("speed", "speeding", "5.31"), (25.0, 0.0)),
        ("limit_in_zone", ("needless", "needless_slow", "3.24"), (0.0, 25.0)),
        ("stop_and_no_turn", ("needless", "needless_stop", "2.4"), (25.0, 0.0)),
        ("yield_and_direction", ("give_way", "encroached", "2.4"), (25.0, 0.0)),
        ("yield_and_direction", ("needless", "needless_yield", "2.1"), (25.0, 0.0)),
        ("limit_and_bus_lane", ("needless", "needless_detour", "3.24"), (0.0, 25.0)),
        ("temporary_limit", ("speed", "speeding", "3.24", "sign_1"), (25.0, 0.0)),
        ("temporary_limit", ("needless", "needless_slow", "3.24", "sign_0"), (0.0, 25.0)),
    ],
)
def test_a_square_names_the_sign_that_was_broken(
    table, tmp_path: Path, type_id: str, said: tuple[str, ...], share: tuple[float, float]
) -> None:
    """idm breaks a sign in two rows of one square of two; a square with a row missing does not count."""
    names = ("rule", "clause", "sign_code", "sign_id")[: len(said)]
    event = asdict(made.violation(3.0)) | dict(zip(names, said, strict=True))
    kind = {"scenario_type": type_id, "group": "two_signs"}
    rows = []
    for m in range(3):
        for end in ("", "-c", "b", "b-c"):
            name = f"{type_id}-m{m}-v0"
            row = episode("idm", 0, m, 0) | kind | {"scenario_id": name + end, "pair_id": name + end.removesuffix("-c")}
            half = {"half": "contrast"} if end.endswith("c") else {}
            rows.append(row | half | (lost() if m == 1 and "b" not in end else {}))
    where = {"planner": "idm", "number": 0, "target": True}
    events = [event | where | {"scenario_id": f"{type_id}-m1-v0{end}"} for end in ("", "-c")]
    make_run(tmp_path / "r", rows[:-1], events=events, asked=12)
    (row,) = table("squares", "r", "--allow-partial")
    assert (row["type"], row["planner"], row["n"]) == (type_id, "idm", "2")
    assert [number(row[key]) for key in ("squared_scd", "rows", "first", "last")] == [50.0, 3.0, *share]
    first = table("floor", "r", "--allow-partial")[0]
    assert next(name for name in first if name.endswith("scd")) == "squared_scd"
    assert (first["n"], number(first["squared_scd"])) == ("2", 50.0)
