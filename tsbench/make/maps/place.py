"""Where a place is, by its name: its outline from Nominatim, OpenStreetMap's geocoder, which OSMnx asks."""

from __future__ import annotations

import osmnx
import requests
from shapely.geometry import Polygon

import tsbench
from tsbench.core.errors import InputError
from tsbench.make.maps.overpass import Outline

GEOCODER = "https://nominatim.openstreetmap.org/"
# An outline travels in an address, and is written into the city's file. Tolerances in degrees: 10 m and more.
_MOST_CORNERS, _TOLERANCE, _COARSER = 150, 1e-4, 1.5
_TIMEOUT_S = 60


def outline_of(place: str, geocoder: str = GEOCODER) -> Outline:
    """The outline of a place: of its largest part, with at most _MOST_CORNERS corners.

    Raises InputError: no such place, one without an outline, or a geocoder that does not answer.
    """
    settings = osmnx.settings
    settings.use_cache, settings.nominatim_url, settings.requests_timeout = False, geocoder, _TIMEOUT_S
    settings.http_user_agent = f"tsbench/{tsbench.__version__}"
    try:
        found = osmnx.geocode_to_gdf(place).geometry.iloc[0]
    except requests.RequestException as problem:
        raise InputError(f"{geocoder}: cannot be asked ({_line(problem)})") from None
    except (ValueError, TypeError, KeyError) as problem:
        # No place of that name, a place that is a point, or an unusable answer.
        raise InputError(f"--place {place}: {geocoder} has no outline of it ({_line(problem)})") from None
    part: Polygon = max(getattr(found, "geoms", [found]), key=lambda one: one.area)
    outline, tolerance = part.exterior, _TOLERANCE
    while len(outline.coords) > _MOST_CORNERS + 1:
        outline, tolerance = part.exterior.simplify(tolerance), tolerance * _COARSER
    return tuple((round(lon, 5), round(lat, 5)) for lon, lat in outline.coords[:-1])


def _line(problem: Exception) -> str:
    return " ".join(str(problem).split())[:200]
