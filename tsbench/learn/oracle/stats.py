"""`tsbench oracle stats` and `verify`: what the table of chosen drives holds, and whether they replay."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.core.errors import InputError
from tsbench.core.seeds import seed_of
from tsbench.learn.oracle.store import KIND
from tsbench.learn.oracle.trajectories import Recorded, Replayer, read_trajectories
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

if TYPE_CHECKING:
    from tsbench.report.analyses.model import Analysis


def stats(path: Path, split: str) -> Analysis:
    """The composition of a table. Raises InputError for drives of scenarios that the split does not have."""
    from tsbench.report.analyses.oracle import Chosen, composition  # brings matplotlib

    rows, drives = _read(path, split)
    chosen = [
        Chosen(d.scenario_id, rows[d.scenario_id].group, d.planner, d.rank, d.part, len(d.commands) * DT_S)
        for d in drives
        if d.rank
    ]
    return composition(chosen, Counter(row.group for row in rows.values()), split)


def verify(path: Path, split: str, limit: int | None) -> int:
    """Replay drives of a table, `limit` of them in shuffled order; returns how many.

    Raises SimulationError, which says which and how, for one that comes out otherwise than it was recorded.
    """
    rows, drives = _read(path, split)
    chosen = sorted(drives, key=lambda d: seed_of(KIND, "verify", d.scenario_id, d.planner))[:limit]
    simulation = Simulation()
    replayer = Replayer(simulation, SceneLoader())
    try:
        for drive in sorted(chosen, key=lambda d: rows[d.scenario_id].net):
            replayer.replay(drive, rows[drive.scenario_id])
    finally:
        simulation.close()
    return len(chosen)


def _read(path: Path, split: str) -> tuple[dict[str, ScenarioSpec], list[Recorded]]:
    drives = read_trajectories(path)
    rows = {row.scenario_id: row for row in read_table(table_path(split))}
    unknown = next((d.scenario_id for d in drives if d.scenario_id not in rows), None)
    if unknown is not None:
        raise InputError(f"{path}: scenario {unknown} is not in {table_path(split)}")
    return rows, drives
