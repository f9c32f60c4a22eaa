"""Reading the project's Parquet tables: one clear line for whatever is wrong with a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError

VERSION_KEY = "tsbench_schema"
# Far more than any table of ours has.
_MOST_ROWS, _MOST_BYTES = 20_000_000, 1 << 32


def open_table(path: Path, schema: pa.Schema, hint: str, columns: Sequence[str] | None = None) -> pa.Table:
    """The table with `schema`'s columns (or `columns` of them), cast to its types.

    `schema` names its version in its metadata under VERSION_KEY. Raises InputError (file, problem) for a missing,
    unreadable or foreign file; `hint` says what makes the file.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such table ({hint})")
    names = list(schema.names if columns is None else columns)
    wanted = (schema.metadata or {}).get(VERSION_KEY.encode(), b"none").decode()
    try:
        file = pq.ParquetFile(path)
        version = (file.schema_arrow.metadata or {}).get(VERSION_KEY.encode(), b"none").decode()
        missing = [name for name in names if name not in file.schema_arrow.names]
        check_size(file, path)
        if version == wanted and not missing:
            return file.read(names).cast(pa.schema([schema.field(n) for n in names]))
    except (pa.ArrowException, ValueError, OSError) as error:
        raise InputError(f"{path}: not a readable Parquet table ({' '.join(str(error).split())})") from None
    if version != wanted:
        raise InputError(f"{path}: schema version {version}, this tsbench reads {wanted}")
    raise InputError(f"{path}: column {missing[0]!r} is missing")


def check_size(file: pq.ParquetFile, path: Path) -> None:
    """Raises InputError, before anything is unpacked, for a file that says it holds more than any of ours."""
    about = file.metadata
    size = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
    if about.num_rows > _MOST_ROWS or size > _MOST_BYTES:
        raise InputError(
            f"{path}: {about.num_rows} rows, {size >> 20} MiB unpacked: too large for a table of ours"
        )


def save_table(table: pa.Table, path: Path, encodings: Mapping[str, str] | None = None) -> None:
    """Write a table atomically: the same rows give the same bytes.

    encodings: Parquet's, by leaf column; the flat columns without one are dictionaries.
    """
    part = path.with_suffix(".part")
    options: dict[str, Any] = {}
    if encodings:
        flat = [f.name for f in table.schema if not pa.types.is_nested(f.type) and f.name not in encodings]
        options = {"use_dictionary": flat, "column_encoding": dict(encodings)}
    pq.write_table(table, part, compression="zstd", compression_level=9, **options)
    part.replace(path)
