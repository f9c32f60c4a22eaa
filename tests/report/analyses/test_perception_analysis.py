"""SCD over perception levels, and the cause of a failure as its trace tells it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import run_builders

from tsbench.core.errors import InputError
from tsbench.episode.perception import SignDetection
from tsbench.episode.trace import Trace
from tsbench.metrics.scd import PAIRED
from tsbench.report.analyses.analysis import Value
from tsbench.report.analyses.failures import cause_of_failure, failures
from tsbench.report.analyses.paired_runs import perception
from tsbench.report.analyses.run_pool import read_pool
from tsbench.scenarios.data_set import DataSet

POOR, GOOD = run_builders.level("poor"), run_builders.level("good")
RIGHT = SignDetection(10, "right", "s", "target", "2.4", None, 0.0, 0.0, 40.0, 10.0)


def traced(*told: SignDetection, begun: float | None = 5.0) -> Trace:
    against = [] if begun is None else [SimpleNamespace(start_s=begun)]
    snapshots = [SimpleNamespace(time=k * 0.1) for k in range(60)]
    return cast(Trace, SimpleNamespace(told=told, against=against, snapshots=snapshots))


@pytest.mark.parametrize(
    ("told", "cause"),
    [
        ((), "missed"),
        ((replace(RIGHT, kind="post"),), "missed"),
        # Another plate was read, not the sign.
        ((replace(RIGHT, role="context"),), "missed"),
        ((replace(RIGHT, kind="misread"),), "misread"),
        ((RIGHT,), ""),
        # v^2 / 2d is 3 m/s2 at 16.7 m.
        ((replace(RIGHT, ahead_m=17.0),), ""),
        ((replace(RIGHT, ahead_m=16.0),), "late"),
        ((replace(RIGHT, ahead_m=-1.0),), "late"),
        ((replace(RIGHT, step=51),), "late"),
        ((RIGHT, replace(RIGHT, kind="false", role="")), "false"),
        ((replace(RIGHT, step=51), replace(RIGHT, kind="false", role="")), "late"),
    ],
)
def test_cause_of_a_failure(told: tuple[SignDetection, ...], cause: str) -> None:
    assert cause_of_failure(traced(*told), DataSet().catalog) == cause


def test_a_row_for_each_planner_and_level_the_best_eyes_first(tmp_path: Path) -> None:
    lost = {"speed_limit_m0_v0": run_builders.lost("over_limit")}
    runs = [
        run_builders.make_run(tmp_path / "poor", run_builders.pairs("a", **lost), perception=POOR),
        run_builders.make_run(tmp_path / "exact", [*run_builders.pairs("a"), *run_builders.pairs("b")]),
        run_builders.make_run(tmp_path / "good", run_builders.pairs("a"), perception=GOOD),
    ]
    # The levels have one selection, however many planners drove it.
    found = perception(runs, allow_partial=False)
    rows = [dict(zip((c.key for c in found.table.columns), row.cells, strict=True)) for row in found.table.rows]
    assert [(r["planner"], r["level"]) for r in rows] == [("a", "exact"), ("a", "good"), ("a", "poor"), ("b", "exact")]
    assert [cast(Value, r[PAIRED]).value for r in rows[:2]] == [100.0, 100.0]
    assert cast(Value, rows[2][PAIRED]).value == pytest.approx(50.0 * (1.0 + 23 / 24))
    assert (rows[2]["failed"], rows[2]["missed"]) == (1, None)
    assert found.draw is not None
    found.draw()


@pytest.mark.parametrize(
    ("second", "words"),
    [({}, "all runs are of level exact"), ({"perception": POOR, "limit": 3}, "different scenarios"),
     ({"perception": POOR, "contract": "ff" * 32}, "contract")],
)  # fmt: skip
def test_runs_that_are_no_curve(tmp_path: Path, second: dict[str, Any], words: str) -> None:
    a = run_builders.make_run(tmp_path / "a", run_builders.pairs("a"))
    b = run_builders.make_run(tmp_path / "b", run_builders.pairs("b"), **second)
    with pytest.raises(InputError, match=words):
        perception([a, b], allow_partial=False)


def test_other_analyses_take_one_level_only(tmp_path: Path) -> None:
    a = run_builders.make_run(tmp_path / "a", run_builders.pairs("a"))
    b = run_builders.make_run(tmp_path / "b", run_builders.pairs("b"), perception=POOR)
    with pytest.raises(InputError, match="tsbench analyse perception compares such runs"):
        read_pool([a, b], allow_partial=False)
    pool = read_pool([b], allow_partial=False)
    assert "perception poor" in pool.title("x")
    assert "told_missed" in [c.key for c in failures(pool).table.columns]
    assert "told_missed" not in [c.key for c in failures(read_pool([a], False)).table.columns]
