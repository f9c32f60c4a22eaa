"""`tsbench oracle stats` and `verify`: what the table of chosen drives holds, and whether they replay."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.core.errors import InputError
from tsbench.core.seeds import seed_of
from tsbench.learn.oracle.store import KIND
from tsbench.learn.oracle.trajectories import Recorded, Replayer, stream_trajectories
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

if TYPE_CHECKING:
    from tsbench.report.analyses.analysis import Analysis


def stats(path: Path, split: str) -> Analysis:
    """The composition of a table. Raises InputError for drives of scenarios that the split does not have."""
    from tsbench.report.analyses.oracle_composition import RankedDrive, composition  # brings matplotlib

    rows = _rows(split)
    chosen = [
        RankedDrive(d.scenario_id, rows[d.scenario_id].group, d.planner, d.rank, d.part, len(d.commands) * DT_S)
        for d in _drives(path, split, rows)
        if d.rank
    ]
    return composition(chosen, Counter(row.group for row in rows.values()), split)


def verify(path: Path, split: str, limit: int | None) -> int:
    """Replay drives of a table, `limit` of them drawn by hash; returns how many.

    Raises SimulationError, which says which and how, for one that comes out otherwise than it was recorded.
    """
    rows = _rows(split)
    names = ((d.scenario_id, d.planner) for d in _drives(path, split, rows))
    chosen = set(sorted(names, key=lambda name: seed_of(KIND, "verify", *name))[:limit])
    simulation = Simulation()
    replayer = Replayer(simulation, SceneLoader(DataSet.in_use()))
    try:
        # In the table's order, in which scenarios of a network follow each other.
        for drive in stream_trajectories(path):
            if (drive.scenario_id, drive.planner) in chosen:
                replayer.replay(drive, rows[drive.scenario_id])
    finally:
        simulation.close()
    return len(chosen)


def _rows(split: str) -> dict[str, ScenarioSpec]:
    return {row.scenario_id: row for row in DataSet.in_use().table(split)}


def _drives(path: Path, split: str, rows: Mapping[str, ScenarioSpec]) -> Iterator[Recorded]:
    """The drives of a table, one after the other. Raises InputError for one of a scenario that `rows` lack."""
    for drive in stream_trajectories(path):
        if drive.scenario_id not in rows:
            raise InputError(f"{path}: scenario {drive.scenario_id} is not in {DataSet.in_use().table_path(split)}")
        yield drive
