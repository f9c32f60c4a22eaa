"""Dataclasses as tables: their fields are the columns, and what is written comes back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pytest

from tsbench.core.errors import InputError
from tsbench.core.parquet import VERSION_KEY, fields_of, read_rows, save_rows


@dataclass(frozen=True)
class Thing:
    name: str
    seed: int
    size: float | None
    known: bool | None
    parts: tuple[str, ...]
    counts: tuple[int, ...]


SCHEMA = pa.schema(fields_of(Thing, seed=pa.int64())).with_metadata({VERSION_KEY: "1"})
THINGS = [Thing("b", 1 << 40, None, True, ("x", "y"), ()), Thing("a", 2, 0.1, None, (), (3, 4))]


def test_columns_are_the_fields() -> None:
    assert [(f.name, str(f.type), f.nullable) for f in SCHEMA] == [
        ("name", "string", False), ("seed", "int64", False), ("size", "double", True), ("known", "bool", True),
        ("parts", "list<item: string>", False), ("counts", "list<item: int64>", False),
    ]  # fmt: skip
    assert all(f.nullable for f in fields_of(Thing, nullable=True))


def test_rows_come_back_sorted_and_in_any_order_they_are_the_same_bytes(tmp_path: Path) -> None:
    one, two = tmp_path / "new" / "one.parquet", tmp_path / "two.parquet"
    save_rows(THINGS, one, SCHEMA)
    save_rows(THINGS[::-1], two, SCHEMA)
    assert one.read_bytes() == two.read_bytes()
    assert read_rows(Thing, one, SCHEMA, "") == THINGS[::-1]
    save_rows([], one, SCHEMA)
    assert read_rows(Thing, one, SCHEMA, "") == []


def test_a_table_of_another_version_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    save_rows(THINGS, path, SCHEMA.with_metadata({VERSION_KEY: "2"}))
    with pytest.raises(InputError, match="schema version 2, this tsbench reads 1"):
        read_rows(Thing, path, SCHEMA, "")
    with pytest.raises(InputError, match=r"no such table \(make it\)"):
        read_rows(Thing, tmp_path / "none", SCHEMA, "make it")
