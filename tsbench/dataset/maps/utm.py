"""The one metric frame of all extracts: UTM zone 37 north (WGS 84), as netconvert's `--proj.utm` makes.

Krueger's series to the third order (Karney 2011, "Transverse Mercator with an accuracy of a few nanometers"):
millimetres within the zone, and no projection library is needed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_A = 6378137.0
_F = 1 / 298.257223563
_N = _F / (2 - _F)
_RECTIFYING = _A / (1 + _N) * (1 + _N**2 / 4 + _N**4 / 64)
_K0 = 0.9996
_FALSE_EAST = 500000.0
_ALPHA = (
    _N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16,
    13 * _N**2 / 48 - 3 * _N**3 / 5,
    61 * _N**3 / 240,
)
_BETA = (
    _N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96,
    _N**2 / 48 + _N**3 / 15,
    17 * _N**3 / 480,
)
_CENTRAL_MERIDIAN = np.radians(39.0)
_E = np.sqrt(_F * (2 - _F))


def to_utm(lat: npt.ArrayLike, lon: npt.ArrayLike) -> Floats:
    """Degrees to metres; returns (..., 2) east, north."""
    phi, dlon = np.radians(np.asarray(lat, float)), np.radians(np.asarray(lon, float)) - _CENTRAL_MERIDIAN
    t = np.sinh(np.arctanh(np.sin(phi)) - _E * np.arctanh(_E * np.sin(phi)))
    xi, eta = np.arctan2(t, np.cos(dlon)), np.arctanh(np.sin(dlon) / np.hypot(1.0, t))
    east, north = eta.copy(), xi.copy()
    for order, alpha in enumerate(_ALPHA, start=1):
        east += alpha * np.cos(2 * order * xi) * np.sinh(2 * order * eta)
        north += alpha * np.sin(2 * order * xi) * np.cosh(2 * order * eta)
    return np.stack([_FALSE_EAST + _K0 * _RECTIFYING * east, _K0 * _RECTIFYING * north], axis=-1)


def to_lat_lon(east: npt.ArrayLike, north: npt.ArrayLike) -> Floats:
    """Metres to degrees; returns (..., 2) lat, lon."""
    xi = np.asarray(north, float) / (_K0 * _RECTIFYING)
    eta = (np.asarray(east, float) - _FALSE_EAST) / (_K0 * _RECTIFYING)
    xi0, eta0 = xi.copy(), eta.copy()
    for order, beta in enumerate(_BETA, start=1):
        xi0 -= beta * np.sin(2 * order * xi) * np.cosh(2 * order * eta)
        eta0 -= beta * np.cos(2 * order * xi) * np.sinh(2 * order * eta)
    tau_conformal = np.sin(xi0) / np.hypot(np.sinh(eta0), np.cos(xi0))
    lon = _CENTRAL_MERIDIAN + np.arctan2(np.sinh(eta0), np.cos(xi0))
    psi = np.arcsinh(tau_conformal)
    phi = np.arctan(tau_conformal)
    for _ in range(6):
        phi = np.arcsin(np.tanh(psi + _E * np.arctanh(_E * np.sin(phi))))
    degrees: Floats = np.degrees(np.stack([phi, lon], axis=-1))
    return degrees
