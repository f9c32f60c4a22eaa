"""What is said of a foreign exception."""

from __future__ import annotations

from bdb import BdbQuit
from pathlib import Path

import pytest

from tsbench.core.errors import cause_in_planner
from tsbench.planners.planner_spec import import_attribute

PLANNER = """
import json
from tsbench import Control

def divides():
    return 1 / 0

def reads():
    return json.loads("{")

def moves():
    Control(1.0, 0.0).steering = 3
"""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("divides", "ZeroDivisionError: division by zero (mine.py:6)"),
        ("reads", "JSONDecodeError: "),
        ("moves", "FrozenInstanceError: cannot assign to field 'steering' (mine.py:12)"),
    ],
)
def test_a_planners_own_line_is_named(tmp_path: Path, name: str, said: str) -> None:
    """Of the frames the last that is neither Python's nor tsbench's."""
    (tmp_path / "mine.py").write_text(PLANNER)
    called = import_attribute(f"{tmp_path}/mine.py", name, "--planner")
    with pytest.raises(Exception, match=r".") as problem:
        called()
    told = cause_in_planner(problem.value)
    assert told.startswith(said)
    assert told.endswith(")")
    assert "(mine.py:" in told


def test_a_breakpoint_in_a_run_names_the_debugger() -> None:
    assert "tsbench debug" in cause_in_planner(BdbQuit())
