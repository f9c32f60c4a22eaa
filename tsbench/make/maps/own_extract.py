"""An extract of the user's: its entry in the description of a city.

The outline of a place comes by its name from Nominatim, OpenStreetMap's geocoder, which OSMnx asks.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import osmium
import osmnx
import requests
from shapely.geometry import Polygon

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.make.maps.extracts import Outline, check_file, ending_of, extract_name, opened_xml
from tsbench.make.maps.osm import contents_of, osm_file

# Where the head of a file gives its time: in PBF, and in answers of Overpass.
_HEAD = ("osmosis_replication_timestamp", "timestamp")
_META = re.compile(rb'<meta osm_base=["\'](\d{4}-\d\d-\d\d)')
_LOOKED_AT = 1 << 16
_EPOCH = "1970-01-01"


GEOCODER = "https://nominatim.openstreetmap.org/"
# An outline travels in an address, and is written into the city's file. Tolerances in degrees: 10 m and more.
_MOST_CORNERS, _TOLERANCE, _COARSER = 150, 1e-4, 1.5
_TIMEOUT_S = 60


def facts_of(path: Path, date: str | None, address: str | None) -> tuple[int, dict[str, Any], tuple[str, ...]]:
    """The UTM zone of an extract, its keys in a city's file, and what of it is left out.

    date: of OpenStreetMap; None: as the file says. address: where it can be had; None: only its name is known.
    Raises InputError for a file that is no whole extract, has no node, or does not say its date.
    """
    check_file(path)
    contents = contents_of(path)
    zone = contents.places.zone
    if not zone:
        raise InputError(f"{path}: no node of it has a place: this is no map")
    day = date or date_of(path)
    if day is None:
        raise InputError(f"{path}: does not say of which day it is: say it with --date YYYY-MM-DD")
    named = {"name": extract_name(path), "date": day, "address": address or f"the file {path.name}"}
    return zone, {**named, "sha256": sha256_of(path), "bytes": path.stat().st_size}, contents.lines


def date_of(path: Path) -> str | None:
    """The day (YYYY-MM-DD) of an extract's roads: by its head, else by its newest object, else None."""
    with osmium.io.Reader(osm_file(path), osmium.osm.NOTHING) as reader:
        head = reader.header()
        told: str | None = next((day for key in _HEAD if (day := head.get(key)[: len(_EPOCH)])), None)
    if told is None and not ending_of(path.name).endswith("pbf"):
        with opened_xml(path) as stream:
            found = _META.search(stream.read(_LOOKED_AT))
        told = found and found[1].decode()
    if told:
        return told
    newest = max((f"{one.timestamp:%Y-%m-%d}" for one in osmium.FileProcessor(osm_file(path))), default=_EPOCH)
    return newest if newest > _EPOCH else None


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
