"""`tsbench campaign`: the runs of a file, driven once, continued, with one table; a wrong file is one line."""

from __future__ import annotations

import csv
import json
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from run_helpers import Bench

DEFAULTS = "defaults: {split: test, workers: 1, types: [speed_limit]}\n"
GOOD, RAISES = "fake_planners:Good", "fake_planners:Raises"
TWO = f"""{DEFAULTS}
runs:
  - {{name: first, planner: "{GOOD}"}}
  - {{name: second, planner: "{RAISES}", mask-signs: true, trace: none}}
analyses:
  - {{analysis: floor, name: above, runs: [second]}}
"""
TABLES = ("episodes.parquet", "violations.parquet", "summary.json", "summary.md")


def write(bench: Bench, text: str) -> None:
    (bench.folder / "c.yaml").write_text(text)


def manifest(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "run.json").read_text())
    return found


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.*")}


def tables(run: Path) -> list[bytes]:
    return [(run / name).read_bytes() for name in TABLES]


def table(folder: Path) -> list[tuple[str, str]]:
    with (folder / "analyses" / "campaign.csv").open(encoding="utf-8") as file:
        return [(row["run"], row["planner"]) for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, make_data: Callable[..., Path]) -> Bench:
    """A data folder with an undisturbed campaign in it."""
    folder = tmp_path_factory.mktemp("whole")
    bench = Bench(make_data(folder / "data", maps=1), folder)
    write(bench, TWO)
    done = bench.run("campaign", "c.yaml", expect=1)  # of the error outcome
    assert done.stdout.splitlines()[:2] == [
        "first: 10 of 10 episodes finished, 0 with an error outcome",
        "second: 10 of 10 episodes finished, 1 with an error outcome",
    ]
    return bench


def test_a_run_is_that_of_the_command_and_is_driven_once(whole: Bench) -> None:
    folder = whole.folder / "runs" / "c"
    alone = ("--split", "test", "--workers", "1", "--types", "speed_limit", "--trace", "none")
    whole.run("run", *alone, "--planner", RAISES, "--mask-signs", "--out", "second", expect=1)
    assert tables(folder / "second") == tables(whole.folder / "second")
    ours, theirs = (manifest(one / "second") for one in (folder, whole.folder))
    assert ours["effective"] == theirs["effective"]
    assert table(folder) == [("first", "Good"), ("second", "Raises")]
    assert "| Raises |" in (folder / "analyses" / "above.md").read_text()

    before = contents(folder)
    again = whole.run("campaign", "c.yaml", expect=1)
    assert again.stderr.count("nothing is driven") == 2
    assert contents(folder) == before


def test_it_stops_at_ctrl_c_and_goes_on(whole: Bench) -> None:
    process = whole.start_paused(3, "campaign", "c.yaml", "--out", "stopped")
    process.send_signal(signal.SIGINT)
    whole.go(process, expect=130)
    stopped = whole.folder / "stopped"
    assert manifest(stopped / "first")["status"] == "interrupted"
    assert [path.name for path in stopped.iterdir()] == ["first"]
    whole.run("campaign", "c.yaml", "--out", "stopped", expect=1)
    for name in ("first", "second"):
        assert manifest(stopped / name)["status"] == "complete"
        assert tables(stopped / name) == tables(whole.folder / "runs" / "c" / name)


def test_the_command_line_goes_before_the_file(bench: Bench) -> None:
    write(bench, TWO)
    done = bench.run("campaign", "c.yaml", "--limit", "2", "--types", "yield", "--only", "first")
    assert "analysis above: not made without second" in done.stdout
    (run,) = (bench.folder / "runs" / "c").glob("*/run.json")
    asked = manifest(run.parent)["asked"]
    assert isinstance(asked, dict)
    assert (asked["limit"], asked["types"], asked["workers"]) == (2, ["yield"], 1)


def test_a_run_that_cannot_be_driven_does_not_keep_others_from_it(bench: Bench) -> None:
    broken = f"  - {{name: broken, planner: nowhere, limit: 2}}\n  - {{name: good, planner: '{GOOD}', limit: 2}}\n"
    write(bench, f"{DEFAULTS}runs:\n{broken}")
    done = bench.run("campaign", "c.yaml", expect=2)
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("broken: ")]
    assert "planner 'nowhere': no such planner" in line
    assert table(bench.folder / "runs" / "c") == [("good", "Good")]


def test_levels_of_perception_are_a_run_each_and_stored_runs_are_enough_for_the_table(bench: Bench) -> None:
    levels = f"runs: [{{name: eyes, planner: '{GOOD}', limit: 2, perception: [exact, good]}}]\n"
    analyses = "analyses: [{analysis: perception, runs: [eyes, eyes-good]}]\n"
    write(bench, DEFAULTS + levels + analyses)
    assert bench.run("campaign", "c.yaml", "--no-drive").stdout.startswith("analysis perception: not made")
    bench.run("campaign", "c.yaml")
    folder = bench.folder / "runs" / "c"
    effective = manifest(folder / "eyes-good")["effective"]
    assert isinstance(effective, dict)
    assert effective["perception"]["name"] == "good"
    made = contents(folder / "analyses")
    # Without traces the causes of failures are as they were found when there were some.
    assert not (folder / "eyes-good" / "traces").exists()
    (folder / "analyses" / "perception.csv").write_text("as it was")
    (folder / "analyses" / "campaign.csv").unlink()
    done = bench.run("campaign", "c.yaml", "--no-drive")
    assert "episodes finished" not in done.stdout
    assert contents(folder / "analyses") == {**made, "perception.csv": b"as it was"}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("runs: [", "c.yaml: line 2: "),
        ("[]", "c.yaml: must be a mapping, not []"),
        ("defaults: {}", "c.yaml: runs: "),
        ("runs: []", "c.yaml: runs: "),
        ("runs: [{name: a, planner: idm, split: dev}]\nrun: 1", "c.yaml: run: unknown key; there are runs, "),
        ("runs: [idm]", "c.yaml: runs: number 1: must be a mapping, not 'idm'"),
        ("runs: [{planner: idm}]", "c.yaml: runs 1: name: None: expected the name of a folder"),
        ("runs: [{name: ../a, planner: idm}]", "c.yaml: runs 1: name: '../a': expected the name of a folder"),
        ("runs: [{name: a, planer: idm}]", "c.yaml: a: planer: no such option; there are "),
        ("runs: [{name: a, planner: idm}]", "c.yaml: a: split: is missing"),
        ("runs: [{name: a, planner: idm, split: moon}]", "c.yaml: a: split: 'moon' is not one of "),
        ("runs: [{name: a, planner: idm, split: test, limit: many}]", "c.yaml: a: limit: 'many' is not a valid"),
        ("runs: [{name: a, planner: idm, split: test, isolate: 1}]", "c.yaml: a: isolate: expected true or false"),
        ("runs: [{name: a, planner: {b: c}, split: test}]", "c.yaml: a: planner: expected a value, or a list"),
        ("runs: [{name: a, planner: idm, out: b}]", "c.yaml: a: out: a campaign gives it itself"),
        ("defaults: {planner: idm, split: test}\nruns: [{name: a}, {name: a}]", "c.yaml: runs: a: two runs have"),
        (
            "defaults: {planner: idm, split: test}\nruns: [{name: a, perception: [exact, good, good]}]",
            "c.yaml: runs: a-good: two runs have",
        ),
        (
            "runs: [{name: a, planner: idm, split: test}]\nanalyses: [{analysis: magic, runs: [a]}]",
            "c.yaml: analyses 1: analysis: 'magic': expected one of main, ",
        ),
        (
            "runs: [{name: a, planner: idm, split: test}]\nanalyses: [{analysis: main, runs: [b]}]",
            "c.yaml: analyses 1: runs: b: no such run; there are a",
        ),
    ],
)
def test_a_wrong_file_is_one_line(text: str, problem: str, bench: Bench) -> None:
    write(bench, text)
    assert bench.refused("campaign", "c.yaml").startswith(problem)
    assert not (bench.folder / "runs").exists()


def test_a_run_that_is_not_in_the_file(bench: Bench) -> None:
    write(bench, TWO)
    told = bench.refused("campaign", "c.yaml", "--only", "third")
    assert told == "--only: third: no such run; there are first, second\n"
