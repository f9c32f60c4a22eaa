"""What a run ends with: how many episodes failed and why, and an example of each cause."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa

from tsbench.report.tables.run_ending import failures

ROWS = [
    ("idm", "a", "arrived", None, True, None),
    ("idm", "b", "timeout", None, False, None),
    ("idm", "c", "arrived", None, False, "encroached"),
    ("idm", "d", "collision", None, False, "encroached"),
    ("reader", "a", "arrived", None, True, None),
    ("mine", "a", "error", "ZeroDivisionError: division\nby zero", False, None),
]
NAMES = ("planner", "scenario_id", "outcome", "error", "scd", "violation_clause")


def test_causes_are_counted_and_shown() -> None:
    table = pa.table({name: [row[k] for row in ROWS] for k, name in enumerate(NAMES)})
    assert list(failures(table, Path("runs/my run"))) == [
        "idm: 3 of 4 episodes failed: 2 encroached, 1 timeout",
        "  encroached  tsbench render 'runs/my run' idm/c",
        "  timeout  tsbench render 'runs/my run' idm/b",
        "mine: 1 of 1 episodes failed: 1 error",
        "  error  a: ZeroDivisionError: division by zero",
    ]
