"""Scenario tables: `scenarios/test.parquet` and those of the other splits, one row per scenario."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, fields_of, read_rows, save_table
from tsbench.core.typed import read_typed
from tsbench.scenarios.spec import CONTRAST, MOST_TICKS, SCHEMA_VERSION, SIGNED, ScenarioSpec

SplitName = Literal["test", "dev", "holdout", "train"]
SPLITS: tuple[str, ...] = get_args(SplitName)
# Tables from before contrast pairs lack them.
_LATER = ("pair_id", "half", "place")
SCHEMA = pa.schema(
    [f.with_nullable(f.nullable or f.name == "pair_id") for f in fields_of(ScenarioSpec, seed=pa.int64())]
).with_metadata({VERSION_KEY: str(SCHEMA_VERSION), **OSM_LICENCE})


def write_table(specs: Iterable[ScenarioSpec], path: Path) -> None:
    """Write rows sorted by scenario id, so that a pair's halves are neighbours: the same rows give the same bytes."""
    rows = [asdict(s) | {"pair_id": s.pair_id or None} for s in sorted(specs, key=lambda s: s.scenario_id)]
    save_table(pa.Table.from_pylist(rows, schema=SCHEMA), path)


def read_table(path: Path, hint: str = "tsbench scenarios build makes one") -> list[ScenarioSpec]:
    """Rows in the table's order, as they are stored. hint: where a table comes from.

    Raises InputError for a missing, broken or foreign file, and for impossible rows.
    """
    at = path.stat() if path.is_file() else None
    return list(_read(path, hint, at and (at.st_ino, at.st_size, at.st_mtime_ns, at.st_ctime_ns)))


@lru_cache(maxsize=len(SPLITS))
def _read(path: Path, hint: str, _state: tuple[int, ...] | None) -> tuple[ScenarioSpec, ...]:
    """As it is in this state, read once per process; what cannot be read is no answer that is kept."""
    specs = read_rows(ScenarioSpec, path, SCHEMA, hint, later=_LATER)
    _check(specs, path)
    return tuple(specs)


def _check(specs: list[ScenarioSpec], path: Path) -> None:
    seen: set[str] = set()
    for number, spec in enumerate(specs):
        problem = "the id occurs twice" if spec.scenario_id in seen else _problem(spec)
        if problem:
            raise InputError(f"{path}: row {number} ({spec.scenario_id}): {problem}")
        seen.add(spec.scenario_id)


def _problem(spec: ScenarioSpec) -> str:
    """What is impossible in a row, "" if nothing is."""
    if spec.split not in SPLITS:
        return f"unknown split {spec.split!r}"
    if not 0 < spec.horizon <= MOST_TICKS or not 0.0 <= spec.initial_speed < math.inf:
        return f"horizon {spec.horizon} or initial speed {spec.initial_speed} is impossible"
    own_pair = spec.scenario_id == spec.pair_name
    if spec.half not in (SIGNED, CONTRAST) or (spec.half == CONTRAST) == own_pair:
        return f"half {spec.half!r} of pair {spec.pair_id!r} is impossible"
    # The type names the store that the other two are in.
    if any(name.startswith("/") or ".." in name.split("/") for name in (spec.pair_type, spec.net, spec.additional)):
        return "a scene file outside the data folder"
    return ""


def scene_editions(path: Path) -> dict[str, str]:
    """The edition that the scenes of each split are of, proven under its rules; {} without a file.

    Raises InputError for a file with anything else in it.
    """
    if not path.is_file():
        return {}
    found = read_typed(dict[SplitName, str], path, "list of editions")
    return {str(split): edition for split, edition in found.items()}
