"""A folder to analyse runs in."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest
from command_line import Command, in_process


@pytest.fixture
def analyse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """`tsbench analyse` in a folder of its own, without drawing, which takes time: tests of figures draw them all."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    # Imported now, it keeps the real one, also for the tests after this.
    import_module("tsbench.report.forest")
    monkeypatch.setattr("tsbench.report.charts.save_chart", lambda draw, *paths: None)
    return in_process("analyse", capsys)
