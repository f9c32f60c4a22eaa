"""Scenario tables: `scenarios/test.parquet` and those of the other splits, one row per scenario."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import pyarrow as pa
import yaml

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, fields_of, read_rows, save_table
from tsbench.core.paths import OWN_CITY, city_names, dataset_file, dataset_root, fetch_hint, source_city
from tsbench.core.typed import read_typed
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import CONTRAST, MOST_TICKS, SCHEMA_VERSION, SIGNED, ScenarioSpec
from tsbench.signs.catalog import mirror_in_use

SplitName = Literal["test", "dev", "holdout", "train"]
SPLITS: tuple[str, ...] = get_args(SplitName)
# Tables from before contrast pairs lack them.
_LATER = ("pair_id", "half", "place")
SCHEMA = pa.schema(
    [f.with_nullable(f.nullable or f.name == "pair_id") for f in fields_of(ScenarioSpec, seed=pa.int64())]
).with_metadata({VERSION_KEY: str(SCHEMA_VERSION), **OSM_LICENCE})


def table_path(split: str, root: Path | None = None) -> Path:
    return dataset_file(f"scenarios/{split}.parquet") if root is None else root / f"{split}.parquet"


def splits_there(root: Path | None = None) -> tuple[str, ...]:
    """The splits whose tables are here: all but test are optional."""
    return tuple(split for split in SPLITS if table_path(split, root).is_file())


def write_table(specs: Iterable[ScenarioSpec], path: Path) -> None:
    """Write rows sorted by scenario id, so that a pair's halves are neighbours: the same rows give the same bytes."""
    rows = [asdict(s) | {"pair_id": s.pair_id or None} for s in sorted(specs, key=lambda s: s.scenario_id)]
    save_table(pa.Table.from_pylist(rows, schema=SCHEMA), path)


def read_table(path: Path) -> list[ScenarioSpec]:
    """Rows in the table's order. Raises InputError for a missing, broken or foreign file, and for impossible rows."""
    own = source_city() == OWN_CITY
    made = "brings the released one, tsbench scenarios build makes one" if own else "makes it"
    hint = f"{fetch_hint(path.stem)} {made}"
    there = splits_there(path.parent)
    if not own and not there and source_city() not in city_names():
        raise InputError(f"--city {source_city()}: no such city; there are {', '.join(city_names())}")
    if not own and path.stem in SPLITS and path.stem not in there and there:
        raise InputError(f"{path}: {source_city()} has no {path.stem} split; it has {', '.join(there)}")
    at = path.stat() if path.is_file() else None
    specs = _read(path, hint, at and (at.st_ino, at.st_size, at.st_mtime_ns, at.st_ctime_ns))
    mirror = mirror_in_use()
    return list(specs) if mirror is None else [mirrored_row(spec, mirror) for spec in specs]


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
    if any(
        name.startswith("/") or ".." in name.split("/")
        for name in (spec.pair_type, spec.net, spec.additional)
    ):
        return "a scene file outside the data folder"
    return ""


def scene_editions(root: Path | None = None) -> dict[str, str]:
    """The edition that the scenes of each split are of, proven under its rules; {} without a file.

    Raises InputError for a file with anything else in it.
    """
    path = dataset_file("scenarios/editions.yaml") if root is None else root / "editions.yaml"
    if not path.is_file():
        return {}
    found = read_typed(dict[SplitName, str], path, "list of editions")
    return {str(split): edition for split, edition in found.items()}


def write_scene_editions(scenes: Mapping[str, str]) -> None:
    """Write the edition of each split of the data in use down."""
    write_atomic(dataset_root() / "scenarios" / "editions.yaml", yaml.safe_dump(dict(scenes)).encode())
