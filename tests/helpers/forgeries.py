"""What a submitter could do to a run and its files to look better."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.files import sha256_of

Json = dict[str, Any]


def change_manifest(run: Path, **changes: object) -> None:
    """Other values stand in a run's manifest."""
    path = run / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def change_rows(run: Path, change: Callable[[list[Json]], list[Json]]) -> None:
    """A run has other episodes in its table; its manifest names the new file."""
    path = run / "episodes.parquet"
    table = pq.read_table(path)
    pq.write_table(pa.Table.from_pylist(change(table.to_pylist()), schema=table.schema), path)
    files = json.loads((run / "run.json").read_text())["files"]
    change_manifest(run, files=files | {path.name: sha256_of(path)})


def pass_all(run: Path) -> None:
    """Every episode of a run's table passed."""
    change_rows(run, lambda rows: [row | {"scd": True} for row in rows])


def rewrite_trace(
    path: Path, head: Callable[[Json], object] = bool, table: Callable[[pa.Table], pa.Table] = lambda table: table
) -> None:
    """A trace with other metadata, or with another table. head: changes the metadata."""
    with pq.ParquetFile(path) as file:
        told, ticks = json.loads(file.metadata.metadata[b"tsbench.trace"]), table(file.read())
    head(told)
    with pq.ParquetWriter(path, ticks.schema, compression="zstd", write_page_checksum=True) as writer:
        writer.write_table(ticks)
        writer.add_key_value_metadata({"tsbench.trace": json.dumps(told)})


def with_column(table: pa.Table, name: str, change: Callable[[list[Any]], list[Any]]) -> pa.Table:
    """The table with other values in a column."""
    field = table.schema.field(name)
    values = pa.array(change(table[name].to_pylist()), field.type)
    return table.set_column(table.schema.get_field_index(name), field, values)


def slow_down(path: Path) -> None:
    """A trace in which the ego drove half as fast."""
    rewrite_trace(path, table=lambda ticks: with_column(ticks, "ego_speed", lambda all_: [0.5 * v for v in all_]))


def flip_byte(path: Path, at: int) -> None:
    """One bit of one byte of a file is another."""
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)
