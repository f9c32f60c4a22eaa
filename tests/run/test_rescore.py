"""What judging again finds: a run that did not drive what its commands say, and what it writes for reports."""

from __future__ import annotations

import io
import json
import shutil
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pytest
from forgeries import rewrite_trace, with_column

from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.run.log.read import RESCORED, read_rescored, read_run, write_rescored
from tsbench.run.rescore import rescore
from tsbench.scenarios.data_set import DataSet

RUN = ["run", "--split", "dev", "--types", "speed_limit", "--variants", "0", "--half", "signed", "--limit", "1",
       "--trace", "all", "--workers", "1"]  # fmt: skip
# Obeys the sign by standing, and arrives all the same: its process is that of the loop.
CHEAT = """
from dataclasses import replace
import tsbench.episode.episode as loop
from tsbench import Control
from tsbench.planners.idm import Idm

honest = loop.advance

def advance(motion, acceleration, steering):
    Leaper.ticks += 1
    moved = honest(motion, acceleration, steering)
    return replace(moved, x=moved.x + LEAP) if Leaper.ticks == 20 else moved

class Leaper:
    ticks = 0
    def __init__(self):
        self.driver = Idm()
        loop.advance = advance
    def reset(self, context):
        Leaper.ticks = 0
        self.driver.reset(context)
    def act(self, observation):
        return self.driver.act(observation)
"""


def tsbench(folder: Path, *arguments: str) -> str:
    told = io.StringIO()
    with chdir(folder), redirect_stdout(told), pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert not ended.value.code, told.getvalue()
    return told.getvalue()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An honest run, and two of planners that leap in the middle."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "far.py").write_text(CHEAT.replace("LEAP", "1.5"))
    (folder / "near.py").write_text(CHEAT.replace("LEAP", "1e-6"))
    for name, planner in (("honest", "idm"), ("far", "far.py:Leaper"), ("near", "near.py:Leaper")):
        tsbench(folder, *RUN, "--planner", planner, "--out", name)
    return folder


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    """A copy of the honest run."""
    return Path(shutil.copytree(made / "honest", tmp_path / "copy"))


def edit(folder: Path, column: str, tick: int, value: object) -> None:
    """Change one value of the only trace of a run."""
    (path,) = (folder / "traces").rglob("*.parquet")

    def change(values: list[object]) -> list[object]:
        values[tick] = value(values[tick]) if callable(value) else value
        return values

    rewrite_trace(path, table=lambda ticks: with_column(ticks, column, change))


def test_an_honest_run_agrees(made: Path) -> None:
    result = rescore(made / "honest")
    assert (result.disagreements, result.traces, result.untraced, result.note) == ((), 1, 0, "")


@pytest.mark.parametrize(("name", "metres"), [("far", "1.5"), ("near", "1e-06")])
def test_a_planner_that_leaps_by_patching_the_loop_is_named(made: Path, name: str, metres: str) -> None:
    """With episode, tick and distance; its tables agree with its trace, which earlier was all that was asked."""
    result = rescore(made / name)
    (line,) = result.disagreements
    assert line.startswith("Leaper speed_limit-")
    assert "its poses do not follow from its commands at 1 of " in line
    assert line.endswith(f"first tick 20: {metres} m from where its command leads")


@pytest.mark.parametrize(
    ("column", "tick", "value", "told"),
    [
        ("ego_x", 0, lambda x: x + 5.0, "first tick 0: 5 m from the start of the scene"),
        ("ego_y", 7, lambda y: y - 0.25, "first tick 7: 0.25 m from where its command leads"),
        ("ego_x", 7, float("nan"), "first tick 7: nan m from"),
        ("ego_speed", 7, lambda v: v - 1.0, "first tick 7: speed is"),
        ("ego_lane", 7, 0, "first tick 7: lane is 0"),
        ("acceleration", 7, 3.0, "first tick 8: "),
        ("steering", 7, 0.1, "first tick 8: "),
        ("step", 7, 8, "tick 7 of its trace is numbered 8"),
        ("acceleration", 7, None, "no command leads there"),
    ],
)
def test_an_edited_trace_is_named(copy: Path, column: str, tick: int, value: object, told: str) -> None:
    edit(copy, column, tick, value)
    lines = rescore(copy).disagreements
    assert any(told in line for line in lines), lines


def test_a_trace_of_another_scene_is_named(copy: Path) -> None:
    (path,) = (copy / "traces").rglob("*.parquet")
    rewrite_trace(path, head=lambda told: told["scenario"].update(seed=told["scenario"]["seed"] + 1))
    assert any("its trace is of another scenario than the table's row" in s for s in rescore(copy).disagreements)


def test_what_rescore_writes_is_what_a_report_says(copy: Path) -> None:
    assert read_run(copy).rescored == "not rescored"
    tsbench(copy.parent, "rescore", "copy")
    found = read_rescored(copy)
    assert (found.traces, found.untraced, found.disagreements) == (1, 0, 0)
    run = read_run(copy)
    assert (found.contract, found.edition) == (run.contract, run.edition)
    assert run.rescored == f"rescored with edition {run.edition}: 1 of 1 episodes by their traces, all agree"
    assert run.rescored in tsbench(copy.parent, "compare", "copy", "copy")
    tsbench(copy.parent, "report", "copy", "--out", "page.html")
    page = (copy.parent / "page.html").read_text(encoding="utf-8")
    assert run.rescored in page
    assert f"edition {run.edition}, contract <code>{run.contract}" in page
    # Looking again at the complete run minds neither.
    assert "does not belong" not in tsbench(copy.parent, *RUN, "--planner", "idm", "--out", "copy")


def test_what_was_judged_has_to_be_what_is_there(copy: Path) -> None:
    run = read_run(copy)
    write_rescored(copy, DataSet(), "f" * 64, 1, 0, 3)
    told = read_run(copy).rescored
    assert "under another contract (ffffffffffff): 1 of 1 episodes by their traces, 3 disagreements" in told
    text = (copy / RESCORED).read_text()
    (copy / RESCORED).write_text(text.replace(run.manifest["files"]["episodes.parquet"], "0" * 64))
    assert read_run(copy).rescored.startswith("rescored before its tables were changed")
    for broken in ("[]", "{", json.dumps({"schema_version": 1}), "[" * 100_000):
        (copy / RESCORED).write_text(broken)
        with pytest.raises(InputError, match=r"rescored\.json: (must be a mapping|cannot be read|.*missing)"):
            _ = read_run(copy).rescored
