"""The drivers of examples/attacks.py and peeks.py: each does what it is named for, and none passes a pair by it."""

from __future__ import annotations

import math
from pathlib import Path

import pandas as pd
import pytest

import tsbench
from tsbench.scenarios.data_set import DataSet
from tsbench.sim.junction_traffic import JunctionTraffic

ROOT = Path(tsbench.__file__).parent.parent
WATCHERS = ("Stands", "Creeps", "Dips")
WHERE = dict.fromkeys(
    ("Remembers", *WATCHERS, "Follows", "Between", "Rushes", "Hastens", "Presses", "Brushes", "Weaves"), "attacks"
) | dict.fromkeys(("Peeks", "Lowest"), "peeks")
TYPES = ("main_road", "yield", "speed_limit")


@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Of each driver on a pair of each type; processes matter to who remembers alone."""
    paths = {name: f"{ROOT}/examples/{file}.py:{name}" for name, file in WHERE.items()} | {"idm": "idm"}
    run = tsbench.evaluate(
        [paths.pop("Remembers"), "blind"], split="dev", types=list(TYPES), limit=6, workers=1, trace="none",
        out=tmp_path_factory.mktemp("attacks") / "run",
    )  # fmt: skip
    driven = [
        {**(tsbench.drive(path, scene, split="dev").run().record or {}), "planner": name}
        for name, path in paths.items()
        for scene in run.episodes.scenario_id.unique()
    ]
    return pd.concat([run.episodes, pd.DataFrame(driven)])


def rows(episodes: pd.DataFrame, planner: str) -> pd.DataFrame:
    return episodes[episodes.planner == planner].sort_values("scenario_id").reset_index(drop=True)


def test_none_passes_a_pair(episodes: pd.DataFrame) -> None:
    assert not episodes.error.notna().any()
    for name in WHERE:
        passed = rows(episodes, name).groupby("pair_id").scd.all()
        assert len(passed) == len(TYPES)
        assert not passed.any(), f"{name}: {list(passed.index[passed])}"


def test_who_remembers_meets_each_scene_for_the_first_time(episodes: pd.DataFrame) -> None:
    told = ["scenario_id", "outcome", "scd", "steps"]
    assert rows(episodes, "Remembers")[told].equals(rows(episodes, "blind")[told])


@pytest.mark.parametrize("name", [*WATCHERS, "Peeks"])
def test_who_watches_takes_more_time_than_who_does_not(episodes: pd.DataFrame, name: str) -> None:
    ours, idm = rows(episodes, name), rows(episodes, "idm")
    junctions = ours.pair_id.str.startswith(("main_road", "yield"))
    both = junctions & (ours.outcome == "arrived") & (idm.outcome == "arrived")
    assert both.any()
    assert (ours.steps[both] > idm.steps[both]).all()


@pytest.mark.parametrize("name", ["Between", "Lowest"])
def test_who_is_slow_everywhere_keeps_below_what_the_road_allows(episodes: pd.DataFrame, name: str) -> None:
    ours, idm = (rows(episodes, who).query("pair_id.str.startswith('speed_limit')") for who in (name, "idm"))
    assert set(ours.outcome) == {"arrived"}
    assert (ours.mean_speed.to_numpy() < 0.8 * idm.mean_speed.to_numpy()).all()


def test_who_rushes_is_let_through_where_no_convoy_hurries(monkeypatch: pytest.MonkeyPatch) -> None:
    """The attack does what it is named for: without what stops it, it passes half of the pairs."""
    rows_there = [r for r in DataSet().table("dev") if r.pair_type == "main_road"]
    assert len({r.pair_id for r in rows_there}) == 10

    def passed() -> set[str]:
        driven = [
            (r.pair_id, tsbench.drive(f"{ROOT}/examples/attacks.py:Rushes", r.scenario_id, split="dev").run())
            for r in rows_there
        ]
        return {pair for pair, _ in driven} - {pair for pair, d in driven if not (d.record or {})["scd"]}

    assert passed() == set()
    monkeypatch.setattr(JunctionTraffic, "_spare", lambda *_: math.inf)
    assert len(passed()) >= 4
