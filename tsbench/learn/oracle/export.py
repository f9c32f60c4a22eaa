"""The oracle's drives as a Parquet file of ticks: a row per tick, a row group per drive.

No more than one drive is held. Shapes and signs stand in the file's metadata, a data card beside the file.
"""

from __future__ import annotations

import json
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing, write_atomic
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY
from tsbench.episode.episode import Episode
from tsbench.learn.envs.scene_seen import SceneSeen
from tsbench.learn.oracle.card import NAME as CARD
from tsbench.learn.oracle.card import Card
from tsbench.learn.oracle.ticks import REWARDS, driven, shapes
from tsbench.learn.oracle.trajectories import stream_trajectories
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.sim.sumo import Simulation

_TEXT = ("scenario_id", "planner", "part", "type", "sign", "half")


def export(path: Path, split: str, out: Path, rank: int = 1, limit: int | None = None) -> tuple[int, int]:
    """Write the ticks of a table's drives up to `rank` (0 = all of them); the numbers of drives and ticks.

    out: a file. A failed export leaves nothing new.
    """
    data = DataSet.in_use()
    rows = {row.scenario_id: row for row in data.table(split)}
    chosen = (d for d in stream_trajectories(path) if d.scenario_id in rows and (not rank or 0 < d.rank <= rank))
    seen = SceneSeen()
    card, schema = Card(seen), _schema(seen)
    drives = ticks = 0
    simulation = Simulation()
    begin = partial(Episode, simulation=simulation, loader=SceneLoader(data))
    try:
        with io_errors_as_input_errors(out), replacing(out) as part:
            with pq.ParquetWriter(part, schema, compression="zstd") as writer:
                for drive in islice(chosen, limit):
                    one = driven(drives, drive, rows[drive.scenario_id], seen, begin)
                    flat = {**one.facts, "episode_index": one.index}
                    writer.write_table(pa.Table.from_pylist([flat | tick for tick in one.ticks], schema=schema))
                    card.add(one)
                    drives, ticks = drives + 1, ticks + len(one.ticks)
            if not drives:
                raise InputError(f"{path}: has no drive of split {split} up to rank {rank}")
            write_atomic(out.with_name(f"{out.stem}.{CARD}"), card.text(path, split, rank, limit).encode())
    finally:
        simulation.close()
    return drives, ticks


def _schema(seen: SceneSeen) -> pa.Schema:
    numbers = pa.list_(pa.field("element", pa.float32(), nullable=False))
    flattened = {name: list(shape) for name, shape in shapes(seen).items()}
    fields: list[Any] = [pa.field(name, pa.string()) for name in _TEXT]
    fields += [pa.field(name, pa.int32()) for name in ("episode_index", "frame_index")]
    fields += [pa.field("timestamp", pa.float64())]
    fields += [pa.field(name, numbers) for name in (*flattened, "action")]
    fields += [pa.field(f"reward.{name}", pa.float64()) for name in REWARDS]
    fields += [pa.field("done", pa.bool_())]
    told = {"shapes": json.dumps(flattened), "signs": json.dumps(list(seen.codes))}
    return pa.schema(fields).with_metadata({VERSION_KEY: "1", **OSM_LICENCE, **told})
