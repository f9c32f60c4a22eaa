"""The project's Parquet tables: their columns, writing them, and one clear line for whatever is wrong with a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from sys import intern
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError, load
from tsbench.core.files import replacing

VERSION_KEY = "tsbench_schema"
OSM_LICENCE = {"licence": "ODbL 1.0, © OpenStreetMap contributors"}
# Arrow's types of a dataclass's fields, by how these are annotated; "| None" makes a column that may hold nulls.
_TYPES = {
    "str": pa.string(),
    "int": pa.int32(),
    "float": pa.float64(),
    "bool": pa.bool_(),
    "tuple[int, ...]": pa.list_(pa.int64()),
    "tuple[str, ...]": pa.list_(pa.string()),
}
# Far more than any table of ours has.
_MOST_ROWS, _MOST_BYTES, _VALUE_BYTES = 20_000_000, 1 << 32, 8
_PART_ROWS = 2048
# Imported where it is used: it writes docstrings of 280 functions, for longer than most of our modules take.
_COMPUTE = "pyarrow.compute"


Row = TypeVar("Row")


def fields_of(row: type, nullable: bool = False, **other: pa.DataType) -> list[pa.Field]:
    """A column for each field of a dataclass. nullable: of all; else of those alone that may be None.

    other: types by field, where they are not the usual ones of Python's (int32, float64).
    """
    kinds = [(field.name, *str(field.type).partition(" | ")) for field in fields(row)]
    return [
        pa.field(name, other.get(name, _TYPES[kind]), nullable=nullable or bool(none)) for name, kind, _, none in kinds
    ]


def columns(kind: pa.DataType, *names: str, nullable: bool = False) -> list[pa.Field]:
    return [pa.field(name, kind, nullable=nullable) for name in names]


def with_text(table: pa.Table, column: str, *values: str) -> pa.Table:
    """The rows of a table that have one of these values in a column of text."""
    told = [value.encode() for value in values]
    ends = np.cumsum([0, *map(len, told)], dtype=np.int32)
    # From buffers: `pa.array` and `pa.scalar` would import pandas, which takes longer than many an episode.
    wanted = pa.StringArray.from_buffers(len(told), pa.py_buffer(ends), pa.py_buffer(b"".join(told)))
    return table.filter(load(_COMPUTE).is_in(table[column], wanted))


def without(table: pa.Table, column: str) -> pa.Table:
    """The rows of a table that have no mark in a column of truth values."""
    return table.filter(load(_COMPUTE).invert(table[column]))


def save_rows(rows: Iterable[Any], path: Path, schema: pa.Schema) -> None:
    """Write dataclasses sorted by their first field, an id: the same rows give the same bytes in any order."""
    key = schema.names[0]
    plain = sorted((asdict(row) for row in rows), key=lambda row: str(row[key]))
    save_table(pa.Table.from_pylist(plain, schema=schema), path)


def read_rows(row: type[Row], path: Path, schema: pa.Schema, hint: str, later: Sequence[str] = ()) -> list[Row]:
    """The dataclasses that `save_rows` wrote. Raises InputError as `open_table`.

    later: fields that older files lack, or hold nulls in; the default counts then.
    """
    table = open_table(path, schema, hint, later=later)
    return [row(**{k: v for k, v in one.items() if v is not None or k not in later}) for one in dicts_of(table)]


def dicts_of(table: pa.Table) -> Iterator[dict[str, Any]]:
    """The rows; equal words are one string."""
    # In parts: all values as objects of Python take more room than all else.
    for part in table.to_batches(_PART_ROWS):
        for values in zip(*map(values_of, part.columns), strict=True):
            yield dict(zip(part.schema.names, values, strict=True))


def values_of(column: pa.Array | pa.ChunkedArray) -> list[Any]:
    """A column's values; equal words are one string."""
    values = column.to_pylist()
    if pa.types.is_list(column.type):
        return list(map(tuple, values))
    return [v if v is None else intern(v) for v in values] if pa.types.is_string(column.type) else values


def open_table(
    path: Path, schema: pa.Schema, hint: str, columns: Sequence[str] | None = None, later: Sequence[str] = ()
) -> pa.Table:
    """The table with `schema`'s columns (or `columns` of them), cast to its types.

    `schema` names its version in its metadata under VERSION_KEY. Raises InputError (file, problem) for a missing,
    unreadable or foreign file; `hint` says what makes the file. later: columns that older files
    lack; the table then does.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such table ({hint})")
    names = list(schema.names if columns is None else columns)
    wanted = (schema.metadata or {}).get(VERSION_KEY.encode(), b"none").decode()
    try:
        file = pq.ParquetFile(path)
        version = (file.schema_arrow.metadata or {}).get(VERSION_KEY.encode(), b"none").decode()
        there = file.schema_arrow.names
        missing = [name for name in names if name not in (*there, *later)]
        names = [name for name in names if name in there]
        check_size(file, path)
        if version == wanted and not missing:
            return file.read(names).cast(pa.schema([schema.field(n) for n in names]))
    except (pa.ArrowException, ValueError, OSError) as error:
        raise InputError(f"{path}: not a readable Parquet table ({' '.join(str(error).split())})") from None
    if version != wanted:
        raise InputError(f"{path}: schema version {version}, this tsbench reads {wanted}")
    raise InputError(f"{path}: column {missing[0]!r} is missing")


def check_size(file: pq.ParquetFile, path: Path, most_rows: int | None = None, most_bytes: int | None = None) -> None:
    """Raises InputError, before anything is unpacked, for a file that says it holds more than any of ours.

    Its own kind may have closer bounds than all tables.
    """
    most_rows, most_bytes = most_rows or _MOST_ROWS, most_bytes or _MOST_BYTES
    about = file.metadata
    groups = [about.row_group(k) for k in range(about.num_row_groups)]
    # Equal values take next to nothing until they are unpacked.
    values = sum(group.column(k).num_values for group in groups for k in range(group.num_columns))
    size = max(_VALUE_BYTES * values, sum(group.total_byte_size for group in groups))
    if about.num_rows > most_rows or size > most_bytes:
        raise InputError(
            f"{path}: {about.num_rows} rows, {size >> 20} MiB unpacked: too large (at most {most_rows} rows, "
            f"{most_bytes >> 20} MiB)"
        )


def save_table(table: pa.Table, path: Path, encodings: Mapping[str, str] | None = None) -> None:
    """Write a table atomically: the same rows give the same bytes.

    encodings: Parquet's, by leaf column; the flat columns without one are dictionaries.
    """
    options: dict[str, Any] = {}
    if encodings:
        flat = [f.name for f in table.schema if not pa.types.is_nested(f.type) and f.name not in encodings]
        options = {"use_dictionary": flat, "column_encoding": dict(encodings)}
    with replacing(path) as part:
        pq.write_table(table, part, compression="zstd", compression_level=9, **options)


GROUND_FILE = "ground.parquet"
# From the lowest to the highest in a picture.
GROUND_KINDS = ("green", "water", "building")
# shape: polygons as WKB, m in the frame of the map's network, not mirrored.
GROUND_SCHEMA = pa.schema(
    [*columns(pa.string(), "map_id", "kind"), *columns(pa.binary(), "shape")], metadata={VERSION_KEY: "1"}
)
