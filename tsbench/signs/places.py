"""`sign_catalog/places.yaml`: bounds of the places where plates can stand; `Sign.places` says which a sign needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from tsbench.core.paths import data_file, resolved
from tsbench.core.typed import read_sheet
from tsbench.signs.catalog import load_catalog

_Positive = Annotated[float, Meta(gt=0.0, lt=1e300)]


@dataclass(frozen=True)
class Distances:
    """Bounds of the places.

    mouth_m: from the junction to a plate at its road's beginning. zone_m: from a begin to its end at least.
    slack_m: of a plate at a line, a crossing or an obstacle. beside_m: along a road, between the plates of its two
    directions at one border or crossing. ring_m: the longest ring. same_arm_deg: two carriageways of one arm point
    within this. swerve_deg: ways straight on over a junction lead no farther aside and back again.
    """

    mouth_m: _Positive
    zone_m: _Positive
    slack_m: _Positive
    beside_m: _Positive
    ring_m: _Positive
    same_arm_deg: _Positive
    swerve_deg: _Positive


@dataclass(frozen=True)
class PlaceTable:
    """The whole file. speeds: by class of road ("primary") and code, the values (km/h) that a plate may set there."""

    table: str
    distances: Distances
    speeds: Mapping[str, Mapping[str, tuple[float, ...]]]

    def allowed_speeds(self, *, road_class: str, code: str) -> tuple[float, ...] | None:
        """Values that a plate may set on a road of SUMO's class ("highway.primary_link"); None: any."""
        known = self.speeds.get(road_class.removeprefix("highway.").removesuffix("_link"))
        return None if known is None else known.get(code, ())


def load_places(root: Path | None = None) -> PlaceTable:
    """Read and check the table. root: the catalogue's folder; by default the data's. Raises InputError, one line."""
    return _read(resolved(data_file("sign_catalog") if root is None else root))


@cache
def _read(root: Path) -> PlaceTable:
    return read_sheet(PlaceTable, root / "places.yaml", "table", lambda table: _checked(table, root))


def _checked(table: PlaceTable, root: Path) -> PlaceTable:
    signs = load_catalog(root).signs
    for road, by_code in table.speeds.items():
        for code, values in by_code.items():
            posted = signs[code].value if code in signs else None
            if posted is None:
                raise ValueError(f"speeds: {road}: {code}: no sign with a value")
            strange = [value for value in values if value not in posted.allowed]
            if strange:
                raise ValueError(f"speeds: {road}: {code}: the sign sets no {strange[0]:g}")
    return table
