"""Ticks in one Parquet file: a row per tick, a row group per drive. Shapes and signs stand in the file's metadata."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY
from tsbench.envs.scene import SceneSeen
from tsbench.learn.oracle.ticks import REWARDS, Driven, shapes

_TEXT = ("scenario_id", "planner", "part", "type", "sign", "half")


class ParquetWriter:
    def __init__(self, path: Path, seen: SceneSeen) -> None:
        self._schema = _schema(seen)
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")

    def add(self, drive: Driven) -> None:
        flat = {**drive.facts, "episode_index": drive.index}
        self._writer.write_table(
            pa.Table.from_pylist([flat | tick for tick in drive.ticks], schema=self._schema)
        )

    def end(self) -> None:
        """Nothing is missing: what a file of Parquet ends with is written when it is closed."""

    def close(self) -> None:
        self._writer.close()


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
