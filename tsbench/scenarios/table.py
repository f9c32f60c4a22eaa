"""Scenario tables: `scenarios/train.parquet` and `scenarios/test.parquet`, one row per scenario."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, fields
from pathlib import Path

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.parquet import VERSION_KEY, open_table, save_table
from tsbench.core.paths import data_file, fetch_hint
from tsbench.scenarios.spec import SCHEMA_VERSION, ScenarioSpec

SPLITS = ("train", "test")
_TEXT = (
    "scenario_id", "scenario_type", "group", "sign_code", "map_id", "family", "shape", "slot", "split", "net",
    "additional", "net_sha256", "additional_sha256",
)  # fmt: skip
_WHOLE = ("variant", "drivers", "layout", "horizon")


def _field(name: str) -> pa.Field[pa.DataType]:
    if name in _TEXT:
        return pa.field(name, pa.string(), nullable=False)
    if name == "seed":
        return pa.field(name, pa.int64(), nullable=False)
    if name in _WHOLE:
        return pa.field(name, pa.int32(), nullable=False)
    return pa.field(name, pa.float64(), nullable=name == "sign_value")


SCHEMA = pa.schema([_field(f.name) for f in fields(ScenarioSpec)]).with_metadata(
    {VERSION_KEY: str(SCHEMA_VERSION), "licence": "ODbL 1.0, © OpenStreetMap contributors"}
)


def table_path(split: str, root: Path | None = None) -> Path:
    """Where the table of a split stands."""
    return data_file(f"scenarios/{split}.parquet") if root is None else root / f"{split}.parquet"


def write_table(specs: Iterable[ScenarioSpec], path: Path) -> None:
    """Write rows sorted by scenario id, atomically: the same rows give the same bytes."""
    rows = sorted((asdict(s) for s in specs), key=lambda r: str(r["scenario_id"]))
    save_table(pa.Table.from_pylist(rows, schema=SCHEMA), path)


def read_table(path: Path) -> list[ScenarioSpec]:
    """Rows in the table's order. Raises InputError for a missing, broken or foreign file, and for impossible rows."""
    hint = f"{fetch_hint(path.stem)} brings the released one, tsbench scenarios build makes one"
    rows = open_table(path, SCHEMA, hint).to_pylist()
    specs = [ScenarioSpec(**row) for row in rows]
    _check(specs, path)
    return specs


def _check(specs: list[ScenarioSpec], path: Path) -> None:
    seen: set[str] = set()
    for number, spec in enumerate(specs):
        where = f"{path}: row {number} ({spec.scenario_id})"
        if spec.scenario_id in seen:
            raise InputError(f"{where}: the id occurs twice")
        seen.add(spec.scenario_id)
        if spec.split not in SPLITS:
            raise InputError(f"{where}: unknown split {spec.split!r}")
        if not 0 < spec.horizon <= 10_000 or not 0.0 <= spec.initial_speed < math.inf:
            raise InputError(
                f"{where}: horizon {spec.horizon} or initial speed {spec.initial_speed} is impossible"
            )
        # The type names the store that the other two are in.
        files = (Path(spec.scenario_type), Path(spec.net), Path(spec.additional))
        if any(f.is_absolute() or ".." in f.parts for f in files):
            raise InputError(f"{where}: a scene file outside the data folder")
