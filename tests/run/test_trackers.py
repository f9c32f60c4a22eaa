"""The trackers in examples/, against modules that write down what they are told by the real ones' names."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from run_helpers import Bench

ROOT = Path(__file__).resolve().parents[2]
RUN = ["run", "--planner", "fake_planners:Good", "--split", "test", "--limit", "4", "--workers", "1", "--out", "out"]
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
        bench.run(*RUN, "--listener", f"{ROOT}/examples/{name}_tracker.py:{tracker}")
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
