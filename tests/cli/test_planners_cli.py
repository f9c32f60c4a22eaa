"""`tsbench planners`."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import in_process
from episode_builders import spec
from patience import HANG_S

from tsbench.cli.planners import planners
from tsbench.core.errors import SimulationError
from tsbench.episode.outcome import EpisodeResult, Outcome
from tsbench.planners.check import Level, check_statically
from tsbench.planners.registry import names, resolve
from tsbench.run.check_planner import DriveSample, check_driving, choose, findings
from tsbench.scenarios.data_set import DataSet

BAD = """
import os, random, time
from tsbench import Control
kept = []

class Dice:
    def reset(self, context): pass
    def act(self, o): return Control(random.random(), 0.0)

class Sticky:
    def __init__(self): self.n = 0
    def reset(self, context): pass
    def act(self, o):
        self.n += 1
        return Control(1.0 / self.n, 0.0)

class Nothing:
    def reset(self, context): pass
    def act(self, o): return None

class Leaky:
    seen = []
    def reset(self, context): pass
    def act(self, o):
        kept.append(bytearray(100_000))
        print("x" * 100)
        return Control(0.0, 0.0)

class Raises:
    def reset(self, context): pass
    def act(self, o): return Control(1 / 0, 0.0)

class Killer:
    def reset(self, context): pass
    def act(self, o): os._exit(7)

class Sleeper:
    def reset(self, context): pass
    def act(self, o): time.sleep(1e6)

class Broken:
    def __init__(self): raise RuntimeError("no weights")
    def reset(self, context): pass
    def act(self, o): pass
"""


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    path = tmp_path / "bad.py"
    path.write_text(BAD)
    return path


def result(commands: np.ndarray, outcome: Outcome = Outcome.ARRIVED, error: str = "") -> EpisodeResult:
    times = np.full(len(commands), 1e-4)
    return EpisodeResult(spec("s"), "p", outcome, error, "", None, commands, times, 0.0, 0.0, 0.0)


def told(seen: DriveSample, topic: str) -> list[tuple[Level, str]]:
    return [(f.level, f.text) for f in findings(seen, "x.py:It's") if f.topic == topic]


def test_list_names_every_planner() -> None:
    done = CliRunner().invoke(planners, ["list"])
    assert done.exit_code == 0
    assert all(name in done.output for name in names())


def test_what_breaks_off_is_one_line_and_exit_code_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken() -> None:
        raise SimulationError("SUMO broke off\nat 3.0 s")

    monkeypatch.setattr("tsbench.planners.registry.names", broken)
    _, err = in_process("planners", capsys)("list", expect=1)
    assert err == "error: SUMO broke off at 3.0 s\n"


def test_measurements_become_words() -> None:
    steady = np.zeros((5, 2))
    moved = steady + np.arange(5)[:, None] * 0.01
    good = DriveSample([result(moved)], result(moved), result(moved), [100], 0)
    assert all(f.level is not Level.PROBLEM for f in findings(good, "x"))
    random = DriveSample([result(moved)], result(moved), result(moved + 1.0))
    assert told(random, "determinism")[0][0] is Level.PROBLEM
    assert "two new planners" in told(random, "determinism")[0][1]
    sticky = DriveSample([result(moved)], result(moved[:3]), result(moved))
    assert "reset leaves something behind" in told(sticky, "determinism")[0][1]
    assert "step 3" in told(sticky, "determinism")[0][1]
    assert "every command is the same" in str(told(DriveSample([result(steady)]), "range"))
    assert "look like degrees" in str(told(DriveSample([result(moved + 20.0)]), "range"))
    leaky = DriveSample([result(moved)] * 10, memory=[10**7 * k for k in range(1, 11)])
    assert told(leaky, "memory")[0][0] is Level.PROBLEM
    wrong = DriveSample([result(steady[:0], Outcome.INVALID_OUTPUT, "act returned NoneType")])
    assert "returned an invalid command in 1 of 1 scenes: act returned NoneType" in told(wrong, "output")[0][1]


def test_each_scene_that_was_not_reached_has_its_command() -> None:
    steady = np.zeros((5, 2))
    mixed = DriveSample([result(steady, o) for o in (Outcome.ARRIVED, Outcome.OFF_ROAD, Outcome.PLANNER_ERROR)])
    assert told(mixed, "outcomes") == [(Level.NOTE, "3 scenes: 1 arrived, 1 off_road, 1 planner_error")]
    for outcome in ("off_road", "planner_error"):
        command = """tsbench debug --planner 'x.py:It'"'"'s' --scenario s"""
        assert told(mixed, outcome) == [(Level.NOTE, command)]
    assert told(DriveSample([result(steady)]), "outcomes") == [(Level.OK, "1 scenes: 1 arrived")]


def test_nobody_is_told_of_no_problems_off_the_road(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "straight.py").write_text(
        "from tsbench import Control\ndef straight(o): return Control(1.5, 0.2)\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    out, _ = in_process("planners", capsys)("check", "straight.py:straight", "--limit", "2")
    left = re.findall(r"^off_road: tsbench debug --planner straight.py:straight --scenario \S+$", out, re.M)
    assert len(left) == 2
    assert out.endswith("straight.py:straight: 2 scenes not reached\n")


def test_scenes_are_of_every_type_quiet_and_busy() -> None:
    chosen = choose(DataSet().table("test"))
    assert len(chosen) == 10
    assert len({s.scenario_type for s in chosen}) == 10
    assert {s.variant == 0 for s in chosen} == {True, False}
    assert len({s.scenario_id for s in chosen}) == 10


@pytest.mark.parametrize(
    ("name", "topic", "words"),
    [
        ("Dice", "determinism", "two new planners"),
        ("Sticky", "determinism", "reset leaves something behind"),
        ("Nothing", "output", "NoneType"),
        ("Leaky", "printing", "xxxx"),
        ("Raises", "output", r"DivisionError: division by zero \(.*bad.py, line 31, in act\)$"),
        ("Killer", "process", "exit code 7"),
        ("Sleeper", "time", "gave no answer"),
    ],
)
def test_driving_finds_what_is_wrong(bad: Path, name: str, topic: str, words: str) -> None:
    scenes = [s for s in DataSet().table("test") if s.variant == 0][:2]
    # Only who sleeps for ever is given up.
    wait_limit_s = 5.0 if name == "Sleeper" else HANG_S
    found = check_driving(f"{bad}:{name}", scenes, DataSet(), wait_limit_s=wait_limit_s)
    assert re.search(words, " ".join(f.text for f in found if f.topic == topic)), found


def test_static_findings(bad: Path) -> None:
    assert "outlives the episode" in str(check_statically(resolve(f"{bad}:Leaky")))
    broken = check_statically(resolve(f"{bad}:Broken"))
    assert [f.level for f in broken] == [Level.PROBLEM]
    assert "no weights" in broken[0].text
