"""Buildings, greenery and water around a city's maps, from its extracts, for pictures."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import osmium
import pyarrow as pa
import shapely

from tsbench.core.errors import InputError
from tsbench.core.parquet import GROUND_FILE, GROUND_KINDS, GROUND_SCHEMA, VERSION_KEY, save_table
from tsbench.make.city import check_extract, find_extract, load_city
from tsbench.make.maps.osm import contents_of, osm_file
from tsbench.make.maps.utm import Floats, UtmFrame
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import PoolRow, read_pool

_GREEN = {
    "landuse": {"allotments", "cemetery", "forest", "grass", "meadow", "orchard", "recreation_ground", "vineyard"},
    "leisure": {"common", "garden", "golf_course", "park", "pitch", "playground"},
    "natural": {"grassland", "heath", "scrub", "wood"},
}
_WATER = {"landuse": {"basin", "reservoir"}, "natural": {"water"}, "waterway": {"riverbank"}}
# What a picture shows beside the box of its roads; corners nearer to a line than that go; smaller pieces too.
_AROUND_M, _SIMPLER_M, _LEAST_M2, _GRID_M = 120.0, 0.5, 12.0, 0.1
_ATTRIBUTION = "© OpenStreetMap contributors, Open Database License 1.0 (https://opendatacommons.org/licenses/odbl/)"


def write_ground(data: DataSet, osm_dir: Path) -> tuple[Path, dict[str, int]]:
    """Write the file of a city; returns it and how many maps have each kind.

    Raises InputError: an extract that is missing or another than the city's, or no pool.
    """
    city, path = load_city(data.name), data.folder / GROUND_FILE
    used = {row.map_id for split in data.splits for row in data.table(split)}
    maps = [row for row in read_pool(data.pool_path) if row.map_id in used]
    by_source: dict[str, list[PoolRow]] = {}
    for row in maps:
        by_source.setdefault(row.source, []).append(row)
    found: list[tuple[str, str, bytes]] = []
    for extract in city.extracts:
        rows = by_source.get(extract.name, [])
        file = find_extract(data, extract.name, osm_dir)
        check_extract(extract, file)
        if rows:
            found += around(rows, surfaces(file, city.frame))
    found.sort(key=lambda one: (one[0], GROUND_KINDS.index(one[1])))
    facts = {VERSION_KEY: GROUND_SCHEMA.metadata[VERSION_KEY.encode()].decode()}
    facts |= {"licence": "ODbL-1.0", "attribution": _ATTRIBUTION}
    facts |= {f"extract {e.name}": f"SHA-256 {e.sha256}, of {e.date}" for e in city.extracts}
    named = [dict(zip(GROUND_SCHEMA.names, one, strict=True)) for one in found]
    save_table(pa.Table.from_pylist(named, schema=GROUND_SCHEMA.with_metadata(facts)), path)
    return path, {kind: sum(one[1] == kind for one in found) for kind in GROUND_KINDS}


def surfaces(path: Path, frame: UtmFrame) -> list[tuple[str, shapely.Geometry]]:
    """Every building, green or water surface of an extract: kind, polygons in metres of the city. Raises InputError."""
    contents = contents_of(path)
    if contents.as_they_are:
        return _surfaces(path, contents.file, frame)
    # Areas are made of ways whose nodes came before.
    with tempfile.TemporaryDirectory(prefix="tsbench-ground-") as folder:
        tidy = Path(folder) / "extract.osm"
        with osmium.SimpleWriter(str(tidy)) as writer:
            for one in contents.objects():
                writer.add(one)
        return _surfaces(path, osm_file(tidy), frame)


def _surfaces(path: Path, file: Any, frame: UtmFrame) -> list[tuple[str, shapely.Geometry]]:
    """The same of a file in order; path: what the user calls it."""
    found = []
    try:
        for area in osmium.FileProcessor(file).with_areas():
            if area.is_area() and (kind := _kind(area.tags)):
                parts = [
                    shapely.Polygon(_ring(outer, frame), [_ring(hole, frame) for hole in area.inner_rings(outer)])
                    for outer in area.outer_rings()
                ]
                found.append((kind, shapely.make_valid(shapely.MultiPolygon(parts))))
    except (RuntimeError, osmium.InvalidLocationError) as broken:
        raise InputError(f"{path}: not a whole OSM file ({' '.join(str(broken).split())})") from broken
    return found


def _kind(tags: osmium.osm.TagList) -> str | None:
    if tags.get("building", "no") != "no":
        return "building"
    for kind, wanted in (("water", _WATER), ("green", _GREEN)):
        if any(tags.get(key) in values for key, values in wanted.items()):
            return kind
    return None


def _ring(nodes: Iterable[osmium.osm.NodeRef], frame: UtmFrame) -> Floats:
    lat, lon = zip(*((node.lat, node.lon) for node in nodes), strict=True)
    return frame.to_metres(lat, lon)


def around(maps: Iterable[PoolRow], found: list[tuple[str, shapely.Geometry]]) -> Iterator[tuple[str, str, bytes]]:
    """Of each map and kind that is there: what lies in its box and around it, in its own metres, as WKB."""
    tree = shapely.STRtree([shape for _, shape in found])
    for row in maps:
        w, h = row.half_w + _AROUND_M, row.half_h + _AROUND_M
        box = shapely.box(row.east - w, row.north - h, row.east + w, row.north + h)
        near = [found[k] for k in tree.query(box, predicate="intersects").tolist()]
        for kind in GROUND_KINDS:
            parts = [shape for name, shape in near if name == kind]
            cut = shapely.intersection(shapely.union_all(parts), box)
            moved = shapely.transform(cut, lambda points, row=row: points - (row.east, row.north))
            small = shapely.set_precision(shapely.simplify(moved, _SIMPLER_M), _GRID_M)
            kept = [part for part in shapely.get_parts(small) if part.geom_type == "Polygon" and part.area >= _LEAST_M2]
            if kept:
                yield row.map_id, kind, shapely.to_wkb(shapely.MultiPolygon(kept))
