"""The drivers of examples/attacks.py and peeks.py: each does what it is named for, and none passes a pair by it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from once import made_once

import tsbench
from tsbench.scenarios.table import read_table, table_path
from tsbench.sim.junction_traffic import JunctionTraffic

ROOT = Path(tsbench.__file__).parent.parent
WATCHERS = ("Stands", "Creeps", "Dips")
WHERE = dict.fromkeys(
    ("Remembers", *WATCHERS, "Follows", "Between", "Rushes", "Hastens", "Presses", "Brushes", "Weaves"),
    "attacks",
) | dict.fromkeys(("Peeks", "Lowest"), "peeks")
TYPES = ("main_road", "yield", "speed_limit")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tsbench.Run:
    def drive(out: Path) -> None:
        attacks = [f"{ROOT}/examples/{file}.py:{name}" for name, file in WHERE.items()]
        tsbench.evaluate(
            [*attacks, "blind", "idm"], split="dev", types=list(TYPES), limit=6, workers=2, out=out / "run",
            trace="none",
        )  # fmt: skip

    return tsbench.load_run(made_once(tmp_path_factory, "attacks", drive) / "run")


def rows(run: tsbench.Run, planner: str) -> pd.DataFrame:
    return run.episodes[run.episodes.planner == planner].sort_values("scenario_id").reset_index(drop=True)


def test_none_passes_a_pair(run: tsbench.Run) -> None:
    assert not run.episodes.error.notna().any()
    for name in WHERE:
        passed = rows(run, name).groupby("pair_id").scd.all()
        assert len(passed) == len(TYPES)
        assert not passed.any(), f"{name}: {list(passed.index[passed])}"


def test_who_remembers_meets_each_scene_for_the_first_time(run: tsbench.Run) -> None:
    told = ["scenario_id", "outcome", "scd", "steps"]
    assert rows(run, "Remembers")[told].equals(rows(run, "blind")[told])


@pytest.mark.parametrize("name", [*WATCHERS, "Peeks"])
def test_who_watches_takes_more_time_than_who_does_not(run: tsbench.Run, name: str) -> None:
    ours, idm = rows(run, name), rows(run, "idm")
    junctions = ours.pair_id.str.startswith(("main_road", "yield"))
    both = junctions & (ours.outcome == "arrived") & (idm.outcome == "arrived")
    assert both.any()
    assert (ours.steps[both] > idm.steps[both]).all()


@pytest.mark.parametrize("name", ["Between", "Lowest"])
def test_who_is_slow_everywhere_keeps_below_what_the_road_allows(run: tsbench.Run, name: str) -> None:
    ours, idm = (rows(run, who).query("pair_id.str.startswith('speed_limit')") for who in (name, "idm"))
    assert set(ours.outcome) == {"arrived"}
    assert (ours.mean_speed.to_numpy() < 0.8 * idm.mean_speed.to_numpy()).all()


def test_who_rushes_is_let_through_where_no_convoy_hurries(monkeypatch: pytest.MonkeyPatch) -> None:
    """The attack does what it is named for: without what stops it, it passes half of the pairs."""
    rows_there = [r for r in read_table(table_path("dev")) if r.pair_type == "main_road"]
    assert len({r.pair_id for r in rows_there}) == 10

    def passed() -> set[str]:
        driven = [
            (r.pair_id, tsbench.drive(f"{ROOT}/examples/attacks.py:Rushes", r.scenario_id, split="dev").run())
            for r in rows_there
        ]
        return {pair for pair, _ in driven} - {pair for pair, d in driven if not (d.record or {})["scd"]}

    assert passed() == set()
    monkeypatch.setattr(JunctionTraffic, "_late_for", lambda *_: False)
    assert len(passed()) >= 4
