"""Exported ticks are those of the drive, in its half, and what they earn is what the route is worth."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from tsbench.core.errors import InputError, SimulationError
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.envs.seen_tables import PLATE, SceneSeen
from tsbench.learn.oracle.export import export, shapes
from tsbench.learn.oracle.trajectories import QuantisedPlanner, Recorded, fingerprints, steps_of, write_trajectories
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import HALVES


def driven(half: str) -> Recorded:
    row = next(r for r in DataSet().table("dev") if r.pair_type == "speed_limit" and r.half == half)
    planner = QuantisedPlanner(resolve("idm").factory)
    result = EpisodeRunner(LoadedPlanner("idm", lambda: planner)).run(row)
    ego, others = fingerprints(result.facts.snapshots)
    return Recorded(
        row.scenario_id, "idm", 0, "train", 1, 1.0, 1.0, steps_of(result.commands), tuple(planner.intents), ego, others
    )


def test_both_halves_come_out_as_they_were_driven(tmp_path: Path) -> None:
    drives = [driven(half) for half in HALVES]
    write_trajectories(drives, tmp_path / "t.parquet")
    ticks = export(DataSet(), tmp_path / "t.parquet", "dev", tmp_path / "out.parquet")
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


@pytest.mark.slow
def test_the_guides_data_set_gives_drives(tmp_path: Path) -> None:
    """The lines of docs/oracle.md as they stand there, and PyTorch's loader over them."""
    import torch

    guide = (Path(__file__).resolve().parents[3] / "docs" / "oracle.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(import numpy.*?class Ticks.*?)```", guide, re.S)
    assert len(lines.strip().splitlines()) <= 14
    names: dict[str, Any] = {}
    exec(lines, names)
    drives = [driven(half) for half in HALVES]
    write_trajectories(drives, tmp_path / "t.parquet")
    export(DataSet(), tmp_path / "t.parquet", "dev", tmp_path / "ticks.parquet")
    found = list(torch.utils.data.DataLoader(names["Ticks"](tmp_path / "ticks.parquet"), batch_size=None))
    expected = sorted(drives, key=lambda drive: drive.scenario_id)
    for (plates, action), drive in zip(found, expected, strict=True):
        assert plates.shape == (len(drive.commands), 8 * (4 + len(PLATE) + len(SceneSeen().codes)))
        assert plates.dtype == action.dtype == torch.float32
        assert np.array_equal(steps_of(action.numpy().astype(np.float64)), drive.commands)


def test_a_data_card_stands_beside_the_drives(tmp_path: Path) -> None:
    drives = [driven(half) for half in HALVES]
    table = tmp_path / "t.parquet"
    write_trajectories(drives, table)
    counts = export(DataSet(), table, "dev", tmp_path / "ticks.parquet", limit=5)
    card = (tmp_path / "ticks.README.md").read_text(encoding="utf-8")
    assert f"{counts[0]} drives up to rank 1 of the split `dev`: {counts[1]} ticks" in card
    assert "tsbench oracle export --split dev --rank 1 --limit 5" in card
    assert hashlib.sha256(table.read_bytes()).hexdigest() in card
    assert "ODbL" in card
    for line in ("| half `signed` | 1 |", "| half `contrast` | 1 |", "| planner `idm` | 2 |"):
        assert line in card
    told = set(re.findall(r"^\| (`.*?`) \|", card, re.M))
    assert {f"`{name}`" for name in shapes(SceneSeen())} <= told


def test_a_failed_export_leaves_the_file_before_it_and_no_other(tmp_path: Path) -> None:
    good = driven("signed")
    turned = replace(good, commands=-good.commands)
    write_trajectories([turned], tmp_path / "t.parquet")
    out = tmp_path / "out" / "ticks.parquet"
    out.parent.mkdir()
    out.write_bytes(b"before")
    with pytest.raises(SimulationError, match="the replay differs"):
        export(DataSet(), tmp_path / "t.parquet", "dev", out)
    assert [(path.name, path.read_bytes()) for path in out.parent.iterdir()] == [("ticks.parquet", b"before")]


def test_a_table_of_another_split_is_refused(tmp_path: Path) -> None:
    write_trajectories([], tmp_path / "t.parquet")
    with pytest.raises(InputError, match="no drive of split dev"):
        export(DataSet(), tmp_path / "t.parquet", "dev", tmp_path / "out.parquet")
    assert not list(tmp_path.glob("out*"))
