"""How a training names the command that began it."""

from __future__ import annotations

import sys

import pytest

from tsbench.learn.checkpoint import command_line

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("program", ["/somewhere/bin/tsbench", "/somewhere/tsbench/__main__.py"])
def test_a_command_is_the_same_however_tsbench_was_started(program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [program, "train", "plant2", "--seed", "1"])
    assert command_line() == "tsbench train plant2 --seed 1"
