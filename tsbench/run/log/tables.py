"""From the journal to the run's three tables, the same bytes however the episodes came about."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow.json import ParseOptions, ReadOptions, read_json

from tsbench.core.files import io_errors_as_input_errors, replacing, sha256_of
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, open_table
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.run.log.journal import Journal
from tsbench.run.log.record import LATER, SCHEMA_VERSION, TABLES

_LATER = (*LATER, *(metric.column for metric in EPISODE_METRICS if metric.failure is None))
# Episodes in one row group. Part of the format: another number gives other bytes.
_GROUP = 4096


def write_tables(folder: Path, journal: Journal, contract: str) -> None:
    """Write episodes, violations and timing, sorted by (planner, scenario_id), in bounded memory."""
    keys = sorted(journal.done)
    # Rows name places of OpenStreetMap's roads: its licence goes along.
    metadata = {VERSION_KEY: str(SCHEMA_VERSION), "tsbench_contract": contract, **OSM_LICENCE}
    with io_errors_as_input_errors(folder), ExitStack() as stack:
        writers = {}
        for name, schema in TABLES.items():
            path = stack.enter_context(replacing(folder / name))
            options = {"version": "2.6", "compression": "zstd", "compression_level": 3}
            writers[name] = stack.enter_context(pq.ParquetWriter(path, schema.with_metadata(metadata), **options))
        for start in range(0, len(keys), _GROUP):
            tables = tables_of([journal.read(key) for key in keys[start : start + _GROUP]])
            for name, writer in writers.items():
                writer.write_table(tables[name], row_group_size=max(len(tables[name]), 1))


def tables_of(lines: Sequence[Mapping[str, Any]]) -> dict[str, pa.Table]:
    """The three tables of lines of a journal, in the order of the lines."""
    rows = {
        "episodes.parquet": [line["row"] for line in lines],
        "violations.parquet": [event for line in lines for event in line["events"]],
        "timing.parquet": [line["timing"] for line in lines],
    }
    return {name: _table(name, rows[name]) for name in TABLES}


def _table(name: str, rows: list[dict[str, Any]]) -> pa.Table:
    """Rows as Arrow. A missing key or a null where none may be is a defect, and is said so."""
    schema = TABLES[name]
    for field in schema:
        nulls = sum(row[field.name] is None for row in rows)
        if not field.nullable and nulls:
            raise ValueError(f"{name}: column {field.name} has {nulls} nulls")
    if not rows:
        return schema.empty_table()
    told = "\n".join(json.dumps({key: row[key] for key in schema.names}) for row in rows).encode("ascii")
    # `pa.array` would import pandas, which takes longer than many an episode.
    table = read_json(
        pa.BufferReader(told),
        ReadOptions(use_threads=False, block_size=len(told)),
        ParseOptions(explicit_schema=schema),
    )
    return pa.Table.from_arrays(table.columns, schema=schema)


def read_table(path: Path) -> pa.Table:
    """One of the three tables. Raises InputError for a missing, truncated or foreign one.

    A metric that was declared after it was written has no value in it; one whose failures count is not done without.
    Where it is from before pairs, all its rows are signed ones without a pair.
    """
    schema = TABLES[path.name].with_metadata({VERSION_KEY: str(SCHEMA_VERSION)})
    table = open_table(path, schema, "is the folder a tsbench run that has ended?", later=_LATER)
    for field in schema:
        if field.name not in table.column_names:
            table = table.append_column(field, pa.repeat(pa.scalar(LATER.get(field.name), field.type), len(table)))
    return table.select(schema.names)


def file_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 (hex) of each of the tables."""
    with io_errors_as_input_errors(folder):
        return {name: sha256_of(folder / name) for name in TABLES}
