"""`docs/reference/tables.md` against the schemas in the code: every column, its type, and whether it may be null."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa
import pytest

from tsbench.episode import trace_columns
from tsbench.learn.oracle import store as tries
from tsbench.learn.oracle import trajectories
from tsbench.run.log.record import EPISODES, TIMING, VIOLATIONS
from tsbench.scenarios import certificates, data_set, map_pool, store

PAGE = Path(__file__).resolve().parents[1] / "docs/reference/tables.md"
SCHEMAS = {
    "episodes.parquet": EPISODES,
    "violations.parquet": VIOLATIONS,
    "timing.parquet": TIMING,
    "traces/PLANNER/SCENARIO.parquet": trace_columns.SCHEMA,
    "scenarios/SPLIT.parquet": data_set.SCHEMA,
    "scenarios/certificates.parquet": certificates.SCHEMA,
    "scenarios/scenes/SPLIT/TYPE.parquet": store.SCHEMA,
    "sumo_nets/pool.parquet": map_pool.POOL_SCHEMA,
    "scenarios/oracle.parquet": trajectories.SCHEMA,
    "scenarios/oracle_tries.parquet": tries.SCHEMA,
}


def _type(field: pa.Field) -> str:
    kind = field.type
    if pa.types.is_list(kind):
        inner = kind.value_type
        name = "list of " + ("tick and edges" if pa.types.is_struct(inner) else str(inner))
    else:
        name = f"{kind.byte_width} bytes" if pa.types.is_fixed_size_binary(kind) else str(kind)
    return name + (", null" if field.nullable else "")


def documented(text: str) -> dict[str, list[tuple[str, str]]]:
    """By table: the columns with their types, in the page's order."""
    parts = re.split(r"^### `([^`]+)`$", text, flags=re.M)
    rows = re.compile(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", re.M)
    return {name: rows.findall(part) for name, part in zip(parts[1::2], parts[2::2], strict=True)}


def test_no_table_is_left_out() -> None:
    assert set(documented(PAGE.read_text(encoding="utf-8"))) == set(SCHEMAS)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_column_is_there_in_its_order(name: str) -> None:
    there = documented(PAGE.read_text(encoding="utf-8"))[name]
    assert there == [(field.name, _type(field)) for field in SCHEMAS[name]]
