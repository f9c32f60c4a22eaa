"""One city's data set as a value: it is made once, and given to what needs its catalogue, its tables or its scenes.

Scenario tables: `scenarios/test.parquet` and those of the other splits, one row per scenario.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import pyarrow as pa
import yaml

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, fields_of, read_rows, save_table
from tsbench.core.paths import (
    CITY,
    MIRRORED,
    OWN_CITY,
    SHIPPED_CITIES,
    checked_city,
    city_names,
    data_file,
    data_root,
    driven_city,
)
from tsbench.core.typed import read_typed
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import CONTRAST, MOST_TICKS, SCHEMA_VERSION, SIGNED, ScenarioSpec
from tsbench.signs.catalog import Catalog, load_catalog
from tsbench.signs.countries import Artwork, Country

SplitName = Literal["test", "dev", "holdout", "train", "two-signs", "two-signs-dev"]
SPLITS: tuple[str, ...] = get_args(SplitName)
# Tables from before contrast pairs lack them.
_LATER = ("pair_id", "half", "place")
SCHEMA = pa.schema(
    [f.with_nullable(f.nullable or f.name == "pair_id") for f in fields_of(ScenarioSpec, seed=pa.int64())]
).with_metadata({VERSION_KEY: str(SCHEMA_VERSION), **OSM_LICENCE})


@dataclass(frozen=True)
class DataSet:
    """A city's data set. It holds no data: pickled, it is two words.

    city: whose files are read. mirrored: are they read in a mirror, with traffic on the left?
    """

    city: str = OWN_CITY
    mirrored: bool = False

    @classmethod
    def named(cls, name: str) -> DataSet:
        """The data set of a name, such as "mirrored-leeds". Raises InputError for what cannot be one."""
        checked_city(name)
        return cls(name.removeprefix(MIRRORED), name.startswith(MIRRORED))

    @classmethod
    def driven(cls, city: str | None = None) -> DataSet:
        """The data set that is driven for a city; None: the one that TSBENCH_CITY names, else the benchmark's own."""
        name = os.environ.get(CITY) or OWN_CITY if city is None else city
        return cls.named(driven_city(name))

    @property
    def name(self) -> str:
        return f"{MIRRORED}{self.city}" if self.mirrored else self.city

    @property
    def catalog(self) -> Catalog:
        """The signs as they bind there. Raises InputError for a broken file."""
        return load_catalog(mirrored=self.mirrored)

    @property
    def image(self) -> Catalog | None:
        """The catalogue of a mirrored data set, else None."""
        return self.catalog if self.mirrored else None

    def artwork(self, country: Country | None = None) -> Artwork:
        """How plates look there: as in its city, or in the country that a user asks for."""
        return Artwork.of(self.catalog, self.city, country)

    @property
    def _place(self) -> str:
        return "" if self.city == OWN_CITY else f"cities/data/{self.city}/"

    def file(self, name: str) -> Path:
        """A file or folder of it, such as `scenarios/test.parquet`."""
        return data_file(f"{self._place}{name}")

    @property
    def folder(self) -> Path:
        """Where it is made. Raises InputError for a mirrored one: it is made of another."""
        if self.mirrored:
            raise InputError(
                f"{self.name}: is made of {self.city} as it is read: nothing of its own is built or written"
            )
        return data_root() / self._place

    def fetch_hint(self, part: str) -> str:
        """The words that say how to get a part of it (`core.fetch`) that is not here."""
        if self.city in SHIPPED_CITIES:
            part = self.city
        elif self.city != OWN_CITY:
            return f"tsbench city build {self.city} --osm DIR"
        return f"tsbench data fetch --from DIR|URL {part}"

    @property
    def pool_path(self) -> Path:
        return self.file("sumo_nets/pool.parquet")

    @property
    def certificates_path(self) -> Path:
        return self.table_path("certificates")

    def table_path(self, split: str) -> Path:
        return self.file(f"scenarios/{split}.parquet")

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits whose tables are here: all but test are optional."""
        return tuple(split for split in SPLITS if self.table_path(split).is_file())

    def table(self, split: str) -> list[ScenarioSpec]:
        """The rows of a split, in its table's order. Raises InputError for a missing or broken table."""
        own, there, path = self.city == OWN_CITY, self.splits, self.table_path(split)
        if not own and not there and self.city not in city_names():
            raise InputError(f"--city {self.city}: no such city; there are {', '.join(city_names())}")
        if not own and split in SPLITS and split not in there and there:
            raise InputError(f"{path}: {self.city} has no {split} split; it has {', '.join(there)}")
        made = "brings the released one, tsbench scenarios build makes one" if own else "makes it"
        rows = read_table(path, f"{self.fetch_hint(split)} {made}")
        return [mirrored_row(row, self.catalog) for row in rows] if self.mirrored else rows

    def editions(self) -> dict[str, str]:
        """As `table.scene_editions`."""
        return scene_editions(self.file("scenarios/editions.yaml"))

    def write_editions(self, scenes: Mapping[str, str]) -> None:
        """Write the edition of each of its splits down."""
        write_atomic(self.folder / "scenarios" / "editions.yaml", yaml.safe_dump(dict(scenes)).encode())


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
    own_pair = spec.scenario_id == (spec.pair_id or spec.scenario_id)
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
