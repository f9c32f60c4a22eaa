"""Planners that misbehave, workers that die: each costs one episode, with its cause, and the run completes."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from command_line import one_line
from once import made_once
from patience import HANG_S
from run_helpers import Bench

from tsbench.run.execution.local import Pool
from tsbench.run.execution.messages import Limits

BAD_SCENARIO = "speed_limit-000-7"
TOO_LATE = "one call of the planner took more than 4 s of processor time, or 4 s in all"
TOO_LARGE = "the planner's worker took more than 512 MB of memory (--memory-limit)"
BROKEN_LINE = "the planner has closed or used the line between its worker and the run"
EXPECTED = {
    "Raises": ("planner_error", "RuntimeError: no idea what to do with <object object at 0x…>"),
    "PrintsAndRaises": ("planner_error", "ValueError: enough"),
    "ReturnsNone": ("invalid_output", "PlannerOutputError: act returned NoneType, expected Control or Trajectory"),
    "Nan": ("invalid_output", "acceleration nan"),
    "Inf": ("invalid_output", "steering inf"),
    "WrongShape": ("invalid_output", "shapes"),
    "Sleeps": ("planner_timeout", TOO_LATE),
    "Exits": ("planner_error", "the worker process ended in the planner: exit code 7"),
    "SysExits": ("planner_error", "SystemExit: bye"),
    "Segfaults": ("planner_error", "the worker process ended in the planner: SIGSEGV"),
    "KilledAlways": ("planner_error", "the worker process ended in the planner: SIGKILL"),
    "LeavesChild": ("planner_error", "the worker process ended in the planner: exit code 3"),
}
# What each misdeed of `Hostile` comes to, in the order of its scenarios.
HOSTILE = {
    "OwnNumber": ("invalid_output", "Control cannot be read (SystemExit: read)"),
    "RaisesOwn": ("planner_error", "Own: mine"),
    "Interrupts": ("planner_error", "KeyboardInterrupt: stop"),
    "GeneratorExits": ("planner_error", "GeneratorExit: gone"),
    "Surrogate": ("planner_error", "ValueError: half a character: \\ud800"),
    "NoText": ("planner_error", "Mute: (its text cannot be had)"),
    "EndlessText": ("planner_error", "ValueError: word word"),
    "ClosesAll": ("planner_error", BROKEN_LINE),
    "TakesLine": ("planner_error", BROKEN_LINE),
    "WritesLine": ("planner_error", BROKEN_LINE),
    "Gorges": ("planner_error", TOO_LARGE),
    "ChildGorges": ("planner_error", TOO_LARGE),
    "AsksForAll": ("planner_error", "MemoryError"),
    "Computes": ("planner_timeout", TOO_LATE),
    "Daemonises": ("arrived", None),
    "RaisesInReset": ("planner_error", "SystemExit: reset"),
}


def args(*planners: str, **options: str) -> list[str]:
    named = [word for planner in planners for word in ("--planner", f"fake_planners:{planner}")]
    return ["run", *named, "--split", "test", *(w for k, v in options.items() for w in (f"--{k}", v))]


@pytest.fixture(scope="module")
def misbehaved(tmp_path_factory: pytest.TempPathFactory, make_data) -> Path:
    """A run of all bad planners and a good one on the 20 speed limit scenarios."""

    def drive(folder: Path) -> None:
        bench = Bench(make_data(folder / "data"), folder)
        done = bench.run(
            *args(
                "Prints",
                "Good",
                "Forks",
                "Hostile",
                *EXPECTED,
                types="speed_limit",
                out="run",
                workers="2",
                trace="none",
            ),
            expect=1,
            TSBENCH_TEST_LIMITS='{"call": 4.0, "first_call": 4.0, "patience": 1.0, "most_memory": 512.0}',
        )
        assert len(done.stdout) < 20_000
        assert "xxxxx" not in done.stdout + done.stderr
        assert "yyyyy" not in done.stdout + done.stderr

    return made_once(tmp_path_factory, "misbehaved", drive)


def rows_of(run: Path) -> dict[tuple[str, str], dict]:
    rows = pq.ParquetFile(run / "episodes.parquet").read().to_pylist()
    return {(row["planner"], row["scenario_id"]): row for row in rows}


@pytest.mark.parametrize("planner", sorted(EXPECTED))
def test_one_bad_episode_and_its_cause(misbehaved: Path, planner: str) -> None:
    rows = {key[1]: row for key, row in rows_of(misbehaved / "run").items() if key[0] == planner}
    assert len(rows) == 20
    bad = {name: row for name, row in rows.items() if row["outcome"] != "arrived"}
    assert list(bad) == [BAD_SCENARIO]
    outcome, error = EXPECTED[planner]
    assert bad[BAD_SCENARIO]["outcome"] == outcome
    assert error in bad[BAD_SCENARIO]["error"]
    assert bad[BAD_SCENARIO]["scd"] is False
    assert bad[BAD_SCENARIO]["sign_compliant"] is None
    story = (misbehaved / "run" / "errors" / planner / f"{BAD_SCENARIO}.txt").read_text()
    assert error in story
    if planner == "Raises":
        assert "in misbehave" in story
        assert "Last seconds" in story
    if planner in ("PrintsAndRaises", "SysExits"):
        assert (r"last \x1b[2J words" if planner == "PrintsAndRaises" else "bye") in story
    if planner == "Segfaults":
        assert "Segmentation fault" in story
    assert len(story) < 200_000


@pytest.mark.parametrize("planner", ["Good", "Prints", "Forks"])
def test_the_others_are_not_touched(misbehaved: Path, planner: str) -> None:
    rows = [row for key, row in rows_of(misbehaved / "run").items() if key[0] == planner]
    assert [row["outcome"] for row in rows] == ["arrived"] * 20


def test_children_of_a_planner_do_not_outlive_its_worker(misbehaved: Path) -> None:
    pids = [int((misbehaved / name).read_text()) for name in ("mark", "mark.daemon")]
    assert not [pid for pid in pids if Path(f"/proc/{pid}").exists()]


@pytest.mark.parametrize("misdeed", HOSTILE)
def test_a_misdeed_costs_its_own_episode(misbehaved: Path, misdeed: str) -> None:
    rows = sorted(
        (r for r in rows_of(misbehaved / "run").values() if r["planner"] == "Hostile"), key=lambda r: r["seed"]
    )
    row, (outcome, error) = rows[list(HOSTILE).index(misdeed)], HOSTILE[misdeed]
    assert row["outcome"] == outcome
    assert error is None or error in row["error"]


def test_no_misdeed_costs_another_episode(misbehaved: Path) -> None:
    rows = [r for r in rows_of(misbehaved / "run").values() if r["planner"] == "Hostile"]
    assert len(rows) == 20
    assert [r["outcome"] for r in rows if r["seed"] >= 100 + len(HOSTILE)] == ["arrived"] * 4


def test_what_a_planner_does_to_its_process_reaches_no_other(bench: Bench) -> None:
    few = {"types": "speed_limit", "limit": "6", "workers": "1", "trace": "all"}
    bench.run(*args("Spoils", "Thirds", out="after", **few))
    bench.run(*args("Thirds", out="alone", **few))
    found = []
    for out in ("after", "alone"):
        traces = sorted((bench.folder / out / "traces" / "Thirds").glob("*"))
        rows = {key: row for key, row in rows_of(bench.folder / out).items() if key[0] == "Thirds"}
        found.append((rows, [path.read_bytes() for path in traces]))
    assert len(found[0][1]) == 6
    assert found[0] == found[1]


def test_the_manifest_counts_them(misbehaved: Path) -> None:
    manifest = json.loads((misbehaved / "run" / "run.json").read_text())
    assert manifest["status"] == "complete"
    asked = 20 * (4 + len(EXPECTED))
    errors = len(EXPECTED) + len(HOSTILE) - 1
    assert manifest["counts"] == {"asked": asked, "finished": asked, "errors": errors}
    assert not (misbehaved / "run" / "journal.jsonl").exists()


def test_a_worker_killed_from_outside_costs_nothing(tmp_path: Path, make_data) -> None:
    bench, tables = Bench(make_data(tmp_path / "data", maps=1), tmp_path), []
    for name in ("killed", "not-killed"):
        bench.run(*args("KilledOnce", types="speed_limit", out=name))
        assert (bench.folder / "mark").exists()
        tables.append((bench.folder / name / "episodes.parquet").read_bytes())
    assert tables[0] == tables[1]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (None, "there is no file"),
        ("import no_such_module_at_all", "no_such_module_at_all"),
        ("class P:\n    def act(self, o): ...", "no method reset"),
        ("import os; os._exit(9)", "importing or making it ended the process (exit code 9)"),
        ("1 +", "SyntaxError"),
    ],
)
def test_planners_that_are_none(tmp_path: Path, code: str | None, words: str) -> None:
    if code is not None:
        (tmp_path / "planner.py").write_text(code)
    with one_line(words), Pool(1, Limits(start=HANG_S)) as pool:
        pool.probe([f"{tmp_path / 'planner.py'}:P"])
