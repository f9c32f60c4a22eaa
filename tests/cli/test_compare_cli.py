"""`tsbench compare` on run folders made by hand: what it prints, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from command_line import in_process, refused
from PIL import Image
from run_builders import CONTRACT, episodes, failed, level, lost, make_run

from tsbench.core.paths import data_file
from tsbench.report.compare_runs import find_side
from tsbench.run.edition import in_force
from tsbench.run.log.read import read_run
from tsbench.scenarios.data_set import DataSet

# Made-up contracts are nobody's edition.
LOCAL = f"{in_force(DataSet()).name}+local"


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Runs the command in a folder of its own: (stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    return in_process("compare", capsys)


def two(folder: Path) -> None:
    """A run with two planners: idm loses three yield scenes and fails in one, idm-e loses another."""
    idm = episodes("idm", yield_m0_v0=lost(), yield_m1_v1=lost(), yield_m2_v0=lost(), speed_limit_m0_v0=failed("boom"))
    expert = episodes("idm-e", speed_limit_m3_v2=lost("over_limit") | {"outcome": "collision"})
    make_run(folder, [*idm, *expert])


def test_two_planners_of_one_run(run, tmp_path: Path) -> None:
    two(tmp_path / "runs" / "x")
    out, _ = run("runs/x:idm", "runs/x:idm-e", "--csv", "out/flips.csv", "--png", "out/forest.png")
    assert out.startswith("A idm (runs/x), B idm-e (runs/x): 48 paired scenarios\n")
    assert f"contract {CONTRACT}" in out
    assert "lost (A had SCD, B has not): 1\n" in out
    assert "won (B has SCD, A has not): 4\n" in out
    assert "  speed_limit-m3-v2  A arrived, B collision broke over_limit\n" in out
    assert "  yield-m1-v1  A arrived broke did_not_yield, B arrived\n" in out
    assert "  speed_limit-m0-v0  A planner_error (boom), B arrived\n" in out
    lines = [line.split() for line in out.splitlines()]
    # 21 of 24 against 24 of 24: three flips prove nothing, and what would have been found stands beside it.
    row = next(words for words in lines if words[:1] == ["yield"])
    assert row[1:5] == ["strict", "87.5", "100.0", "+12.5"]
    assert row[-3:] == ["0", "3", "24"]
    assert "0.500" in row
    assert float(row[row.index("0.500") + 1]) > 20
    # Strict, then completed: the scene with the error is in the first only.
    overall = next(k for k, words in enumerate(lines) if words[:3] == ["all", "mean", "of"])
    assert lines[overall][-1] == "48"
    assert lines[overall][4] == "strict"
    completed = next(words for words in lines[overall + 1 :] if words[:3] == ["all", "mean", "of"])
    assert (completed[4], completed[-1]) == ("completed", "47")

    with (tmp_path / "out" / "flips.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["change"] for r in rows] == ["lost", "won", "won", "won", "won"]
    assert rows[0]["clause_b"] == "over_limit"
    assert rows[1]["error_a"] == "boom"
    with Image.open(tmp_path / "out" / "forest.png") as picture:
        assert picture.width > 800
        assert len(picture.convert("RGB").getcolors(1 << 24) or []) > 20
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"flips.csv", "forest.png"}


def test_fewer_flips_are_listed_than_counted(run, tmp_path: Path) -> None:
    two(tmp_path / "x")
    out, _ = run("x:idm", "x:idm-e", "--flips", "1")
    assert "won (B has SCD, A has not): 4\n" in out
    assert "  and 3 more: --flips N lists more, --csv FILE writes all\n" in out


def test_a_run_with_one_planner_needs_no_name(run, tmp_path: Path) -> None:
    make_run(tmp_path / "plain", episodes("idm"))
    make_run(tmp_path / "masked", episodes("idm", yield_m0_v0=lost()), mask_signs=True)
    out, _ = run("plain", "masked")
    assert "A idm (plain), B idm (masked): 48 paired scenarios" in out
    assert "note: mask_signs: A False, B True" in out
    assert "FORCED" not in out


def test_other_contracts_are_refused_unless_forced(run, tmp_path: Path) -> None:
    make_run(tmp_path / "a", episodes("idm"))
    make_run(tmp_path / "b", episodes("idm"), contract="d" * 64)
    told = refused(run, "a", "b")
    assert CONTRACT in told
    assert "d" * 64 in told
    assert "--force" in told
    manifest = json.loads((tmp_path / "b" / "run.json").read_text())
    assert "versions differ, so" in told
    own = manifest["versions"]["numpy"]
    manifest["versions"]["numpy"] = "9.9.9"
    (tmp_path / "b" / "run.json").write_text(json.dumps(manifest))
    assert f"versions differ (numpy {own} and 9.9.9), so their scores" in refused(run, "a", "b")
    out, _ = run("a", "b", "--force", "--png", "forced.png")
    assert out.startswith("FORCED, contracts differ (A c0ffeec0ffee, B dddddddddddd): A idm (a)")
    assert f"A edition {LOCAL}, contract {CONTRACT}\nB edition {LOCAL}, contract {'d' * 64}\n" in out


def test_other_eyes_are_refused_unless_forced(run, tmp_path: Path) -> None:
    make_run(tmp_path / "a", episodes("idm"))
    make_run(tmp_path / "b", episodes("idm"), perception=level("poor"))
    told = refused(run, "a", "b")
    assert "a is of perception exact, b of poor: tsbench analyse perception" in told
    out, _ = run("a", "b", "--force")
    assert out.startswith("FORCED, perception levels differ (A exact, B poor): A idm (a)")


def test_other_scenarios_are_refused_unless_forced(run, tmp_path: Path) -> None:
    make_run(tmp_path / "a", episodes("idm", maps=6))
    make_run(tmp_path / "b", episodes("idm", maps=5), limit=40)
    told = refused(run, "a", "b")
    assert "A has 48, B has 40, 40 in common" in told
    refused(run, "a", "b", "--allow-partial")
    out, _ = run("a", "b", "--force")
    assert out.startswith("FORCED, different scenarios (A has 48, B has 40, 40 in common): ")
    assert ": 40 paired scenarios" in out


def test_nothing_in_common(run, tmp_path: Path) -> None:
    rows = episodes("idm")
    make_run(tmp_path / "a", rows[:24], types=["yield"])
    make_run(tmp_path / "b", rows[24:], types=["speed_limit"])
    assert "no scenario in common" in refused(run, "a", "b", "--force")


def test_holes_are_refused_unless_allowed(run, tmp_path: Path) -> None:
    make_run(tmp_path / "a", episodes("idm"))
    make_run(tmp_path / "b", episodes("idm")[:-3], asked=48)
    told = refused(run, "a", "b")
    assert "scenarios without a record (idm (b): 3 of 48): continue the run, or pass --allow-partial" in told
    refused(run, "a", "b", "--force")
    out, _ = run("a", "b", "--allow-partial")
    assert out.startswith("PARTIAL, scenarios without a record (idm (b): 3 of 48): A idm (a), B idm (b): 45 paired")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nowhere", "nowhere: no run folder (expected RUN or RUN:planner"),
        ("x", "x: has planners idm, idm-e: name one, as x:idm"),
        ("x:carl", "x: has no planner 'carl', only idm, idm-e"),
        ("x:", "x: has no planner '', only idm, idm-e"),
    ],
)
def test_a_side_that_is_none(run, tmp_path: Path, text: str, words: str) -> None:
    two(tmp_path / "x")
    assert words in refused(run, text, "x:idm")
    assert words in refused(run, "x:idm", text)


def test_names_of_kept_results(run) -> None:
    out, _ = run("blind", "plant2-ft", "idm-e")
    for planner in ("plant2-ft", "idm-e"):
        assert f"A blind (kept results, floor), B {planner} (kept results): 1080 paired scenarios\n" in out
    assert "planners with kept results (did you mean plant2-ft?): " in refused(run, "blind", "plant3-ft")
    assert "--csv and --png are of one comparison" in refused(run, "blind", "idm", "idm-e", "--csv", "x.csv")


def test_where_all_stand_is_said_last_on_one_screen(run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    out, _ = run("blind", "plant2-ft", "idm-e")
    told = out.partition("\nWhere they stand\n")[2].splitlines()
    assert len(told) < 20
    assert max(map(len, told)) <= 80
    # Once each, with the interval of the difference below it.
    assert [line.split()[:3] for line in told if line[:1] in "AB"] == [
        ["A", "blind", "0.2"], ["B", "plant2-ft", "88.0"], ["B-A,", "paired", "SCD"],
        ["B", "idm-e", "98.6"], ["B-A,", "paired", "SCD"],
    ]  # fmt: skip
    assert told[0].split() == ["%", "all", "types", "priority", "speed", "obstacles", "routing"]


@pytest.mark.parametrize(
    ("planner", "options", "folder"),
    [
        ("plant2-ft", {}, "plant2-ft"),
        ("plant2-ft", {"split": "dev", "variants": "one-per-type"}, "dev"),
        ("plant2-ft", {"mask_signs": True}, "masked"),
        ("plant2-ft", {"perception": level("poor")}, "ft-poor"),
        ("plant2-ft", {"city": "north-bayreuth"}, "north-bayreuth-ft"),
        ("idm", {}, "styles"),
        ("idm", {"variants": "one-per-map", "limit": 58, "half": "both"}, "commonroad"),
    ],
)
def test_the_kept_results_that_are_most_alike(
    tmp_path: Path, planner: str, options: dict[str, Any], folder: str
) -> None:
    asked = 58 if "limit" in options else 48
    types = read_run(data_file("results") / "styles").manifest["effective"]["types"]
    own = read_run(make_run(tmp_path / "x", episodes("mine"), asked=asked, **{"types": types} | options))
    assert find_side(planner, own).run.path.name == folder
    assert find_side(planner).run.path.name == {"idm": "styles"}.get(planner, planner)


def test_what_to_drive_beside_kept_results(run, tmp_path: Path) -> None:
    make_run(tmp_path / "my run", episodes("my planner"))
    command = "tsbench run --planner 'my planner' --split test --variants one-per-map (--force compares"
    told = "my planner (my run) has other scenarios than the kept results of plant2-ft: drive the same ones with "
    assert told + command in refused(run, "my run", "plant2-ft")
    assert command in refused(run, "plant2-ft", "my run")
    make_run(tmp_path / "poor", episodes("mine"), perception=level("poor"))
    assert "--split test --variants one-per-map --perception poor (" in refused(run, "poor", "plant2-ft")
    make_run(tmp_path / "masked", episodes("mine"), mask_signs=True)
    assert "--split test --variants one-per-map --mask-signs (" in refused(run, "masked", "plant2-ft")


HOSTILE = "[red]<b>$x^2$ my:Planner[/]"


def test_names_are_text(run, tmp_path: Path) -> None:
    make_run(tmp_path / "a:1", [*episodes(HOSTILE), *episodes("idm", yield_m0_v0=failed("[bold]no[/bold] <i>"))])
    out, _ = run(f"a:1:{HOSTILE}", "a:1:idm", "--png", "x.png")
    assert out.startswith(f"A {HOSTILE} (a:1), B idm (a:1): 48 paired scenarios\n")
    assert "planner_error ([bold]no[/bold] <i>)" in out
    assert (tmp_path / "x.png").stat().st_size > 10_000


END = {"scd": False, "outcome": "timeout", "duration_s": 30.0}


@pytest.fixture
def failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    return in_process("failures", capsys)


def test_a_list_for_readers_and_for_programs(failures, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm", yield_m0_v0=END, speed_limit_m1_v0=failed("ValueError: π")))
    out, _ = failures("x", "--by", "clause")
    counts = "idm: 2 of 48 episodes failed: 1 error, 1 timeout\n"
    listed = "error: 1 of 2 failures\n  idm/speed_limit-m1-v0\n    signed 2.4, planner_error, error: Va"
    assert out.startswith(counts + listed)
    (first, second) = json.loads(failures("x", "--json")[0])
    assert first["sentence"] == "ValueError: π"
    assert second == {
        "planner": "idm", "scenario_id": "yield-m0-v0", "half": "signed", "outcome": "timeout", "type": "yield",
        "plate": "2.4", "cause": "timeout", "sentence": "At 30.0 s the time was up, after 100 % of its way.",
    }  # fmt: skip


def test_nothing_failed(failures, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm"))
    assert failures("x")[0] == "idm: 0 of 48 episodes failed\n"
    assert json.loads(failures("x", "--json")[0]) == []


def test_a_run_with_holes(failures, tmp_path: Path) -> None:
    make_run(tmp_path / "x", episodes("idm", yield_m0_v0=END), asked=50)
    assert "scenarios without a record (idm: 2 of 50): continue the run" in refused(failures, "x")
    out, _ = failures("x", "--allow-partial")
    assert out.startswith("PARTIAL, scenarios without a record (idm: 2 of 50)\nidm: 1 of 48 episodes failed")


def test_no_run(failures) -> None:
    assert "gone: no run folder" in refused(failures, "gone")
