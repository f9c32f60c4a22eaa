"""Planners that misbehave, workers that die: each costs one episode, with its cause, and the run completes."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from patience import HANG_S
from run_helpers import Bench, assert_gone

from tsbench.errors import InputError
from tsbench.run.executor import Limits
from tsbench.run.workers import Pool

BAD_SCENARIO = "speed_limit-000-7"
EXPECTED = {
    "Raises": ("planner_error", "RuntimeError: no idea what to do with <object object at 0x…>"),
    "PrintsAndRaises": ("planner_error", "ValueError: enough"),
    "ReturnsNone": (
        "invalid_output",
        "PlannerOutputError: act returned NoneType, expected Control or Trajectory",
    ),
    "Nan": ("invalid_output", "acceleration nan"),
    "Inf": ("invalid_output", "steering inf"),
    "WrongShape": ("invalid_output", "shapes"),
    "Sleeps": ("planner_timeout", "one call of the planner took more than 4 s"),
    "Exits": ("planner_error", "the worker process ended in the planner: exit code 7"),
    "SysExits": ("planner_error", "the worker process ended in the planner: exit code 1"),
    "Segfaults": ("planner_error", "the worker process ended in the planner: SIGSEGV"),
    "KilledAlways": ("planner_error", "the worker process ended in the planner: SIGKILL"),
    "LeavesChild": ("planner_error", "the worker process ended in the planner: exit code 3"),
}


def args(*planners: str, **options: str) -> list[str]:
    named = [word for planner in planners for word in ("--planner", f"fake_planners:{planner}")]
    return ["run", *named, "--split", "test", *(w for k, v in options.items() for w in (f"--{k}", v))]


@pytest.fixture(scope="module")
def misbehaved(tmp_path_factory: pytest.TempPathFactory, make_data) -> Path:
    """A run of all bad planners and a good one on the 20 speed limit scenarios."""
    folder = tmp_path_factory.mktemp("misbehaved")
    bench = Bench(make_data(folder / "data"), folder)
    done = bench.run(
        *args("Prints", "Good", "Forks", *EXPECTED, types="speed_limit", out="run", workers="2"),
        expect=1,
        TSBENCH_TEST_LIMITS='{"call": 4.0, "first_call": 4.0}',
    )
    assert len(done.stdout) < 20_000
    assert "xxxxx" not in done.stdout + done.stderr
    assert "yyyyy" not in done.stdout + done.stderr
    return folder


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
        assert ("last words" if planner == "PrintsAndRaises" else "bye") in story
    if planner == "Segfaults":
        assert "Segmentation fault" in story
    assert len(story) < 200_000


@pytest.mark.parametrize("planner", ["Good", "Prints", "Forks"])
def test_the_others_are_not_touched(misbehaved: Path, planner: str) -> None:
    rows = [row for key, row in rows_of(misbehaved / "run").items() if key[0] == planner]
    assert [row["outcome"] for row in rows] == ["arrived"] * 20


def test_children_of_a_planner_do_not_outlive_its_worker(misbehaved: Path) -> None:
    assert_gone([int((misbehaved / "mark").read_text())])


def test_the_manifest_counts_them(misbehaved: Path) -> None:
    manifest = json.loads((misbehaved / "run" / "run.json").read_text())
    assert manifest["status"] == "complete"
    assert manifest["counts"] == {"asked": 300, "finished": 300, "errors": len(EXPECTED)}
    assert not (misbehaved / "run" / "journal.jsonl").exists()


def test_a_worker_killed_from_outside_costs_nothing(bench: Bench) -> None:
    tables = []
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
        ("import os; os._exit(9)", "importing it ended the process (exit code 9)"),
        ("1 +", "SyntaxError"),
    ],
)
def test_planners_that_are_none(tmp_path: Path, code: str | None, words: str) -> None:
    if code is not None:
        (tmp_path / "planner.py").write_text(code)
    with pytest.raises(InputError) as problem, Pool(1, Limits(start=HANG_S)) as pool:
        pool.probe([f"{tmp_path / 'planner.py'}:P"])
    assert words in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_planner_that_is_none_on_the_command_line(bench: Bench) -> None:
    done = bench.run("run", "--planner", "planner.py:P", "--split", "test", "--out", "run", expect=2)
    assert done.stderr.startswith("error: planner 'planner.py:P': there is no file planner.py")
    assert done.stderr.count("\n") == 1
    assert not (bench.folder / "run").exists()


def test_two_planners_of_one_name(bench: Bench) -> None:
    for name in ("a", "b"):
        (bench.folder / f"{name}.py").write_text("def drive(observation): ...")
    both = ["--planner", "a.py:drive", "--planner", "b.py:drive"]
    done = bench.run("run", *both, "--split", "test", expect=2)
    assert "called drive in records, like a.py:drive" in done.stderr
