"""One city's data set as a value: it is made once, and given to what needs its catalogue, its tables or its scenes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
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
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import SPLITS, read_table, scene_editions
from tsbench.signs.catalog import Catalog, load_catalog


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
    def in_use(cls) -> DataSet:
        """The data set that TSBENCH_CITY names; without it the benchmark's own."""
        return cls.named(os.environ.get(CITY) or OWN_CITY)

    @classmethod
    def driven(cls, city: str | None) -> DataSet:
        """The data set that is driven for a city; None: the one in use.

        Raises InputError for one in use that only stores another, whose roads are not as they are.
        """
        if city is not None:
            return cls.named(driven_city(city))
        data = cls.in_use()
        if (driven := driven_city(data.name)) != data.name:
            raise InputError(f"{CITY} {data.name}: is stored in a mirror; name {driven}, or use --city")
        return data

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

    def other_half(self, row: ScenarioSpec) -> ScenarioSpec | None:
        """The row of the other half of a pair, None for a row without one."""
        rows = self.table(row.split) if row.pair_id else []
        return next((one for one in rows if one.pair_id == row.pair_id and one.half != row.half), None)

    def editions(self) -> dict[str, str]:
        """As `table.scene_editions`."""
        return scene_editions(self.file("scenarios/editions.yaml"))

    def write_editions(self, scenes: Mapping[str, str]) -> None:
        """Write the edition of each of its splits down."""
        write_atomic(self.folder / "scenarios" / "editions.yaml", yaml.safe_dump(dict(scenes)).encode())
