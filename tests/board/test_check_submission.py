"""`tsbench planners check --submission`: what would be refused or refuted is said, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import in_process

from tsbench.board import check_submission as subject
from tsbench.board.isolation.isolated_loading import SandboxedPlanner
from tsbench.planners.check import Finding, Level
from tsbench.run.edition import LOCAL, SCORING, in_force
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet

CODE = """
import random
from tsbench import Control

class Steady:
    def reset(self, context): pass
    def act(self, o): return Control(0.5, 0.0)

class Dice(Steady):
    def act(self, o): return Control(random.random(), 0.0)

class Remembers(Steady):
    episodes = 0
    def reset(self, context): self.episodes += 1
    def act(self, o): return Control(0.5 / self.episodes, 0.0)

class Keeps(Remembers):
    keeps_process = True

class Hopeless(Steady):
    def __init__(self): raise ValueError("no weights")
"""


@pytest.fixture
def spec(tmp_path: Path) -> str:
    file = tmp_path / "mine.py"
    file.write_text(CODE)
    return str(file)


@pytest.fixture
def released(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code that was changed since the release counts as released."""
    monkeypatch.setattr(subject, "edition_here", lambda *_: in_force(DataSet()).name)


def by_topic(found: list[Finding]) -> dict[str, Finding]:
    return {finding.topic: finding for finding in found}


def check(spec: str) -> dict[str, Finding]:
    return by_topic(subject.check_submission(spec, 2, "dev", lambda _: None))


def test_a_planner_that_may_be_submitted_has_no_problem(spec: str, released: None) -> None:
    found = check(f"{spec}:Steady")
    assert {finding.level for finding in found.values()} <= {Level.OK, Level.NOTE}
    assert {"contract", "isolation", "code", "determinism"} <= found.keys()
    assert in_force(DataSet()).name in found["contract"].text
    assert found["determinism"].level is found["code"].level is Level.OK


def test_what_a_planner_remembers_is_gone_before_the_next_scene(spec: str, released: None) -> None:
    found = check(f"{spec}:Remembers")
    assert found["determinism"].level is Level.OK
    assert "memory" not in found


@pytest.mark.parametrize("name", ["Dice", "Keeps"])
def test_other_commands_on_the_same_scene_are_a_problem(spec: str, name: str, released: None) -> None:
    found = check(f"{spec}:{name}")
    assert found["determinism"].level is Level.PROBLEM
    assert "refute" in found["determinism"].text


def test_one_that_does_not_come_up_says_why_and_drives_nothing(spec: str, released: None) -> None:
    found = check(f"{spec}:Hopeless")
    assert found["start"].level is Level.PROBLEM
    assert "no weights" in found["start"].text
    assert found.keys() == {"contract", "start"}


def test_changed_code_is_refused_before_anything_is_driven(spec: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subject, "edition_here", lambda *_: f"{in_force(DataSet()).name}{LOCAL}")
    found = check(f"{spec}:Hopeless")
    assert found["contract"].level is Level.PROBLEM
    assert "submit refuses" in found["contract"].text


INFO = PlannerInfo("P-e", "mine.py:P-e", True, True, (), "ab" * 32, "ef" * 32, files=("cd" * 32 + " 644  mine.py",))


@pytest.mark.parametrize(
    ("info", "effects", "topic", "level", "words"),
    [
        (INFO, {"namespaces": "docker"}, "isolation", Level.OK, "in a sandbox (docker)"),
        (INFO, {"namespaces": "bubblewrap 0.8.0"}, "privilege", Level.NOTE, "flagged as privileged"),
        (replace(INFO, may_remember=True), {"namespaces": "bubblewrap 0.8.0"}, "memory", Level.NOTE, "may remember"),
        (INFO, {"namespaces": "bubblewrap 0.8.0"}, "code", Level.OK, "hashed: mine.py, weights abababababab"),
        (
            replace(INFO, spec="idm-e", files=()),
            {"namespaces": "bubblewrap 0.8.0"},
            "code",
            Level.OK,
            f"of tsbench, scoring {SCORING}",
        ),
        (replace(INFO, name="m\u0456ne"), {"namespaces": "bubblewrap 0.8.0"}, "name", Level.PROBLEM, "mixes scripts"),
        (replace(INFO, files=()), {"namespaces": "bubblewrap 0.8.0"}, "code", Level.PROBLEM, "in no file"),
    ],
)
def test_what_of_cell_and_hashes_is_said(
    info: PlannerInfo, effects: Mapping[str, Any], topic: str, level: Level, words: str, released: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(subject, "describe", lambda _: SandboxedPlanner(info, effects))
    found, _ = subject.standing(info.spec, "dev")
    assert by_topic(found)[topic].level is level
    assert words in by_topic(found)[topic].text


def test_the_command_ends_with_1_where_there_is_a_problem_and_names_an_image(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def told(spec: str, *_: object) -> list[Finding]:
        asked.append(spec)
        return [Finding(Level.PROBLEM if "image" in spec else Level.OK, "code", "is [so]")]

    monkeypatch.setattr(subject, "check_submission", told)
    planners = in_process("planners", capsys)
    out, _ = planners("check", "mine.py:Mine", "--submission")
    assert "is [so]" in out
    assert "no problems" in out
    out, _ = planners("check", "mine.py:Mine", "--submission", "--image", "me/it:1", expect=1)
    assert "1 problem(s)" in out
    assert asked == ["mine.py:Mine", "image:me/it:1 mine.py:Mine"]
