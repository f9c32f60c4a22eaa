"""The line of progress shows the figure that the run ends with."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from tsbench.run import run_progress as progress
from tsbench.run.log.record import Row
from tsbench.run.run_progress import ProgressWatcher


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
