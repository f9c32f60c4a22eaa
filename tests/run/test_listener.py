"""Who is told of a run beside its console."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from rich.console import Console
from run_helpers import Bench

from tsbench.core.errors import InputError
from tsbench.run import listener as progress
from tsbench.run.listener import ProgressWatcher, make_listener
from tsbench.run.log.record import Row

MINE = """
from pathlib import Path

class Mine:
    def started(self, run): Path("told").write_text(f"{run.asked} {run.options['split']}\\n")
    def episode(self, row):
        with open("told", "a") as file: file.write(f"{row['planner']} {row['scd']}\\n")
    def finished(self, result):
        with open("told", "a") as file: file.write(f"{result.status} {result.summary is not None}\\n")

class Deaf:
    def started(self, run): pass

def function(run): pass
"""
RUN = ["run", "--planner", "fake_planners:Good", "--split", "test", "--limit", "2", "--workers", "1", "--out", "out"]


@pytest.fixture
def mine(bench: Bench) -> Path:
    path = bench.folder / "tracker.py"
    path.write_text(MINE)
    return path


def test_a_listener_of_ones_own(bench: Bench, mine: Path) -> None:
    bench.run(*RUN, "--listener", f"{mine}:Mine")
    begin, *rows, end = (bench.folder / "told").read_text().splitlines()
    assert begin == "{'Good': 2} test"
    assert [row.split()[0] for row in rows] == ["Good", "Good"]
    assert end == "complete True"
    # All is done: no episode is told twice.
    bench.run(*RUN, "--listener", f"{mine}:Mine")
    assert (bench.folder / "told").read_text().splitlines() == [begin, end]


@pytest.mark.slow
def test_tensorboard(bench: Bench) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    bench.run(*RUN, "--listener", "tensorboard")
    # What it leaves in the run's folder is not foreign there.
    assert bench.run(*RUN).stderr.splitlines() == [
        "note: out: complete since "
        + json.loads((bench.folder / "out" / "run.json").read_text())["finished"]
        + ", nothing is driven; --overwrite drives it again"
    ]
    found = EventAccumulator(str(bench.folder / "out" / "tensorboard")).Reload()
    steps = [one.step for one in found.Scalars("episodes_with_scd/Good")]
    assert steps == [1, 2]
    assert found.Scalars("signed_scd/Good")[0].value in (0.0, 50.0, 100.0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wandb", "expected tensorboard, pkg.module:Class or file.py:Class"),
        ("no_such_module_here:X", "there is no module no_such_module_here"),
        ("{mine}:Deaf", "expected a class with started, episode and finished"),
        ("{mine}:function", "expected a class with started, episode and finished"),
    ],
)
def test_what_is_no_listener(name: str, words: str, mine: Path) -> None:
    with pytest.raises(InputError) as told:
        make_listener(name.format(mine=mine))
    assert words in str(told.value)


ROOT = Path(__file__).resolve().parents[2]
TELL = """
import json

def tell(*what):
    with open("told", "a") as file:
        file.write(json.dumps(what) + "\\n")
"""
WANDB = """
class Summary(dict):
    def __setitem__(self, name, value): tell("end", name, value)

class Run:
    summary = Summary()
    def log(self, data): [tell("log", *item) for item in data.items()]
    def finish(self, exit_code=None): tell("finish", exit_code)

def init(project=None, name=None, config=None):
    tell("init", project, name, config)
    return Run()
"""
MLFLOW = """
def set_experiment(experiment_name): tell("experiment", experiment_name)
def start_run(run_id=None, experiment_id=None, run_name=None): tell("start", run_name)
def log_params(params): tell("params", params)
def log_metric(key, value, step=None): tell("log" if step else "end", key, value)
def end_run(status="FINISHED"): tell("finish", status)
"""


def told(bench: Bench, name: str, stub: str, tracker: str) -> list[list[object]]:
    """What a run of four episodes tells the module `name`, line by line."""
    module = ModuleType(name)
    exec(TELL + stub, module.__dict__)
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, name, module)
        bench.run(*RUN, "--limit", "4", "--listener", f"{ROOT}/examples/{name}_tracker.py:{tracker}")
    return [json.loads(line) for line in (bench.folder / "told").read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize(
    ("name", "stub", "tracker", "head", "end"),
    [("wandb", WANDB, "Wandb", 1, 0), ("mlflow", MLFLOW, "Mlflow", 3, "FINISHED")],
)
def test_a_tracker_is_told_of_the_run(bench: Bench, name: str, stub: str, tracker: str, head: int, end: object) -> None:
    lines = told(bench, name, stub, tracker)
    first, rest = lines[:head], lines[head:]
    manifest = json.loads((bench.folder / "out/run.json").read_text(encoding="utf-8"))
    about = first[-1][-1]
    assert isinstance(about, dict)
    assert about["contract"] == manifest["contract"]
    assert about["split"] == "test"
    assert "out" in [value for line in first for value in line]
    logged = [line[1:] for line in rest if line[0] == "log"]
    assert [key for key, _ in logged] == ["episodes_with_scd/Good"] * 4
    figures = {key: value for kind, key, *value in rest if kind == "end"}
    assert figures["signed_scd/Good"] == [logged[-1][1]]
    assert rest[-1] == ["finish", end]


def row(pair: str | None, passed: bool) -> Row:
    """A row; None: of a collection, which has no pairs."""
    told = {"planner": "idm", "pair_id": pair, "scd": passed}
    return {key: value for key, value in told.items() if value is not None}


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ([("a", True), ("b", False)], "idm SCD 50.0 %"),
        ([("", True), ("", True)], "idm SCD 100.0 %"),
        ([(None, True), (None, True)], "idm SCD 100.0 %"),
        ([("a", True), ("b", True), ("a", False)], "idm paired SCD 0.0 %"),
        ([("a", True), ("b", True), ("a", False), ("b", True)], "idm paired SCD 50.0 %"),
    ],
)
def test_pairs_count_once_both_halves_are_driven(
    rows: list[tuple[str | None, bool]], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    shown = io.StringIO()
    watcher = ProgressWatcher(Console(file=shown))
    watcher.begin({"idm": 4}, [row(*one) for one in rows[:1]])
    for one in rows[1:]:
        watcher.episode(row(*one))
    watcher.end()
    assert shown.getvalue().splitlines()[-1].endswith(told)
