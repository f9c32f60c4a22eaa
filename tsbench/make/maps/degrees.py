"""Places of nodes: numbers of degrees that are none, and roads that leap across the map."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.make.maps.names import ending_of, opened_xml
from tsbench.make.maps.plain_xml import elements
from tsbench.make.maps.utm import zones_at

# No two neighbouring nodes of a road are so far apart.
FARTHEST_KM = 50.0
_KM_PER_DEGREE = 111.2
_UNITS = 10_000_000  # of osmium's, in a degree
_UNDEFINED = 2**31 - 1  # a node without a place
_DEGREES = re.compile(r"-?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_MOST = {f"{which}{axis}": most for axis, most in (("lat", 90.0), ("lon", 180.0)) for which in ("", "min", "max")}
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Places:
    """Nodes that have a place, sorted by id, (n,): id, and place in 1e-7 degrees."""

    ids: Ints
    lon: Ints
    lat: Ints

    @property
    def zone(self) -> int:
        """The zone of UTM in which most of them lie; 0 where there are none."""
        return int(np.bincount(zones_at(self.lon / _UNITS)).argmax()) if len(self.ids) else 0

    def leaps(self, nodes: list[int]) -> bool:
        """Are two neighbouring nodes of a way more than FARTHEST_KM apart? Nodes without a place do not count."""
        if not len(self.ids):
            return False
        wanted = np.array(nodes, np.int64)
        rows = np.searchsorted(self.ids, wanted).clip(max=len(self.ids) - 1)
        rows = rows[self.ids[rows] == wanted]
        lat, lon = self.lat[rows] / _UNITS, self.lon[rows] / _UNITS
        east = (np.diff(lon) + 180.0) % 360.0 - 180.0
        steps = np.hypot(np.diff(lat), east * np.cos(np.radians(lat[:-1])))
        return bool((steps * _KM_PER_DEGREE > FARTHEST_KM).any())


def places_of(ids: Ints, lon: Ints, lat: Ints) -> Places:
    """Those of nodes, (n,), in 1e-7 degrees, some perhaps without a place."""
    there = np.flatnonzero(lon != _UNDEFINED)
    order = there[np.argsort(ids[there], kind="stable")]
    return Places(ids[order], lon[order], lat[order])


def check_numbers(path: Path, lon: Ints, lat: Ints) -> None:
    """Raises InputError for a place, (n,) in 1e-7 degrees, that is not on Earth or was misread."""
    beyond = (lon != _UNDEFINED) & ((np.abs(lon) > 180 * _UNITS) | (np.abs(lat) > 90 * _UNITS))
    if beyond.any() or (lon == 0).any() or (lat == 0).any():
        check_places(path)
    if beyond.any():
        raise InputError(f"{path}: {beyond.sum():,} nodes lie beyond 90 degrees of latitude or 180 of longitude")


def check_places(path: Path) -> None:
    """Raises InputError for the first place in XML that is no number of degrees: osmium reads 1e400 as 0."""
    if ending_of(path.name).endswith("pbf"):
        return
    with opened_xml(path) as stream:
        for element in elements(stream, None):
            for key, most in _MOST.items():
                value = element.get(key)
                if value is None or (_DEGREES.fullmatch(value) and abs(float(value)) <= most):
                    continue
                which = " ".join(filter(None, (str(element.tag), element.get("id") or element.get("ref"))))
                raise InputError(
                    f"{path}: {which}: {key}={value!r:.40} is no number of degrees from -{most:g} to {most:g}: "
                    "write it with a point, such as 55.75"
                )
