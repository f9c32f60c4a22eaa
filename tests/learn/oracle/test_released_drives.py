"""Drives of experts on the train split, one at least of each type and expert: what was recorded is what is driven.

`data/oracle.parquet` holds drives of `tsbench oracle collect --split train --limit 58` and `select`: of all experts,
and of `idm-s1-e`, `idm-s2-e` and `idm-s3-e` each alone, which are seldom the fastest.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tsbench.learn.oracle.collect import experts
from tsbench.learn.oracle.trajectories import Recorded, Replayer, stream_trajectories
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

TABLE = Path(__file__).parent / "data" / "oracle.parquet"
DRIVES = list(stream_trajectories(TABLE))


@pytest.fixture(scope="module")
def replayer() -> Iterator[Replayer]:
    simulation = Simulation()
    yield Replayer(simulation, SceneLoader(DataSet.in_use()))
    simulation.close()


def test_all_types_and_experts_are_in_it(rows: list[ScenarioSpec]) -> None:
    assert {d.scenario_id.partition("-")[0] for d in DRIVES} == {row.pair_type for row in rows}
    assert {d.planner for d in DRIVES} == set(experts())


@pytest.mark.parametrize("recorded", DRIVES, ids=lambda d: f"{d.scenario_id}-{d.planner}")
def test_a_drive_is_replayed_as_it_was_recorded(
    recorded: Recorded, rows: list[ScenarioSpec], replayer: Replayer
) -> None:
    """Else the replay is refused, and says what differs."""
    row = next(row for row in rows if row.scenario_id == recorded.scenario_id)
    facts = replayer.replay(recorded, row)
    assert facts.target.compliant
    assert facts.outcome == "arrived"
