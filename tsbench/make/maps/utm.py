"""The metric frame of an extract: UTM (WGS 84), in the zone in which most of its nodes lie. netconvert is told it.

Krueger's series to the third order (Karney 2011, "Transverse Mercator with an accuracy of a few nanometers"): to 0.1 mm
within the zone. PROJ differs in the last digit of one in a thousand of the committed maps' origins; tests hold the two
together.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError

Floats = npt.NDArray[np.float64]

_A = 6378137.0
_F = 1 / 298.257223563
_N = _F / (2 - _F)
_RECTIFYING = _A / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_K0 = 0.9996
_FALSE_EAST = 500000.0
_ALPHA = (_N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16, 13 * _N**2 / 48 - 3 * _N**3 / 5, 61 * _N**3 / 240)
_BETA = (_N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96, _N**2 / 48 + _N**3 / 15, 17 * _N**3 / 480)
_FALSE_NORTH = 10_000_000.0
_ZONES, _ZONE_DEG = 60, 6
_PROJECTION = re.compile(r"^\+proj=utm \+zone=(\d+)( \+south)? \+ellps=WGS84( |$)")
# A city is no wider; what is, are several.
WIDEST_M = 150_000.0
_E = np.sqrt(_F * (2 - _F))


@dataclass(frozen=True)
class UtmFrame:
    """A zone of UTM, 1 to 60. south: northings count from 10,000 km below the equator, else from the equator.

    mirrored: the world is seen in a mirror that stands on the zone's meridian, as where traffic keeps to the left:
    eastings count westwards. Degrees are always true ones.
    """

    zone: int
    south: bool = False
    mirrored: bool = False

    def to_metres(self, lat: npt.ArrayLike, lon: npt.ArrayLike) -> Floats:
        """Degrees to metres; returns (..., 2) east, north."""
        phi, dlon = np.radians(np.asarray(lat, float)), np.radians(np.asarray(lon, float)) - self._meridian
        dlon = np.where(np.abs(dlon) > np.pi, dlon - np.copysign(2 * np.pi, dlon), dlon) * self._side
        t = np.sinh(np.arctanh(np.sin(phi)) - _E * np.arctanh(_E * np.sin(phi)))
        xi, eta = np.arctan2(t, np.cos(dlon)), np.arctanh(np.sin(dlon) / np.hypot(1.0, t))
        east, north = eta.copy(), xi.copy()
        for order, alpha in enumerate(_ALPHA, start=1):
            east += alpha * np.cos(2 * order * xi) * np.sinh(2 * order * eta)
            north += alpha * np.sin(2 * order * xi) * np.cosh(2 * order * eta)
        scale = _K0 * _RECTIFYING
        return np.stack([_FALSE_EAST + scale * east, scale * north + self._false_north], axis=-1)

    def to_degrees(self, east: npt.ArrayLike, north: npt.ArrayLike) -> Floats:
        """Metres to degrees; returns (..., 2) lat, lon."""
        xi = (np.asarray(north, float) - self._false_north) / (_K0 * _RECTIFYING)
        eta = (np.asarray(east, float) - _FALSE_EAST) / (_K0 * _RECTIFYING)
        xi0, eta0 = xi.copy(), eta.copy()
        for order, beta in enumerate(_BETA, start=1):
            xi0 -= beta * np.sin(2 * order * xi) * np.cosh(2 * order * eta)
            eta0 -= beta * np.cos(2 * order * xi) * np.sinh(2 * order * eta)
        tau_conformal = np.sin(xi0) / np.hypot(np.sinh(eta0), np.cos(xi0))
        lon = self._meridian + self._side * np.arctan2(np.sinh(eta0), np.cos(xi0))
        lon = np.where(np.abs(lon) > np.pi, lon - np.copysign(2 * np.pi, lon), lon)
        psi = np.arcsinh(tau_conformal)
        phi = np.arctan(tau_conformal)
        for _ in range(6):
            phi = np.arcsin(np.tanh(psi + _E * np.arctanh(_E * np.sin(phi))))
        degrees: Floats = np.degrees(np.stack([phi, lon], axis=-1))
        return degrees

    def true_east(self, east: float) -> float:
        """The easting (m) of UTM itself."""
        return _FALSE_EAST + self._side * (east - _FALSE_EAST)

    @property
    def meridian(self) -> int:
        """The zone's central meridian, degrees east."""
        return _ZONE_DEG * self.zone - 183

    @property
    def projection(self) -> str:
        """The zone as netconvert's option `--proj` takes it; northings count from the equator."""
        return f"+proj=utm +zone={self.zone} +ellps=WGS84 +datum=WGS84 +units=m +no_defs"

    @property
    def _meridian(self) -> float:
        return float(np.radians(self.meridian))

    @property
    def _side(self) -> float:
        return -1.0 if self.mirrored else 1.0

    @property
    def _false_north(self) -> float:
        return _FALSE_NORTH if self.south else 0.0

    def __str__(self) -> str:
        return f"UTM zone {self.zone}{' south' if self.south else ''}{' in a mirror' if self.mirrored else ''}"


def zones_at(lon: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """The zones of longitudes (degrees), 1 to 60; of the border between two zones the eastern one."""
    return (np.floor((np.asarray(lon, float) + 180.0) / _ZONE_DEG) % _ZONES).astype(np.int64) + 1


def frame_of(projection: str, what: str) -> UtmFrame:
    """The frame that netconvert says it used (`projParameter` of a network's location).

    Raises InputError, naming `what`, for another projection.
    """
    found = _PROJECTION.match(projection)
    if found is None or not 1 <= int(found[1]) <= _ZONES:
        raise InputError(f"{what}: netconvert used the projection {projection!r}, expected a zone of UTM on WGS 84")
    return UtmFrame(int(found[1]), found[2] is not None)
