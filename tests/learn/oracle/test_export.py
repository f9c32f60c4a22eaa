"""Exported ticks are those of the drive, in its half, and what they earn is what the route is worth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tsbench.core.errors import InputError
from tsbench.envs.stepped_episode import process_episode
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.oracle.export import export
from tsbench.learn.oracle.trajectories import (
    QuantisedPlanner,
    Recorded,
    fingerprints,
    steps_of,
    write_trajectories,
)
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.spec import HALVES
from tsbench.scenarios.table import read_table, table_path


def driven(half: str) -> Recorded:
    row = next(r for r in read_table(table_path("dev")) if r.pair_type == "speed_limit" and r.half == half)
    planner = QuantisedPlanner(resolve("idm").factory)
    result = EpisodeRunner(
        LoadedPlanner("idm", lambda: planner), simulation=process_episode().simulation
    ).run(row)
    assert result.facts is not None
    ego, others = fingerprints(result.facts.snapshots)
    return Recorded(
        row.scenario_id, "idm", 0, "train", 1, 1.0, 1.0, steps_of(result.commands), tuple(planner.intents), ego, others
    )  # fmt: skip


def test_both_halves_come_out_as_they_were_driven(tmp_path: Path) -> None:
    drives = [driven(half) for half in HALVES]
    write_trajectories(drives, tmp_path / "t.parquet")
    ticks = export(tmp_path / "t.parquet", "dev", tmp_path / "out.parquet")
    assert ticks == (2, sum(len(d.commands) for d in drives))
    file = pq.ParquetFile(tmp_path / "out.parquet")
    found = {}
    for k in range(file.num_row_groups):
        table = file.read_row_group(k)
        found[table["scenario_id"][0].as_py()] = set(table["half"].to_pylist())
        drive = next(d for d in drives if d.scenario_id == table["scenario_id"][0].as_py())
        assert np.array_equal(steps_of(np.array(table["action"].to_pylist())), drive.commands)
        assert table["done"].to_pylist() == [False] * (len(table) - 1) + [True]
    assert sorted(found.values(), key=str) == [{"contrast"}, {"signed"}]


def test_a_table_of_another_split_is_refused(tmp_path: Path) -> None:
    write_trajectories([], tmp_path / "t.parquet")
    with pytest.raises(InputError, match="no drive of split dev"):
        export(tmp_path / "t.parquet", "dev", tmp_path / "out.parquet")
    assert not list(tmp_path.glob("out*"))
