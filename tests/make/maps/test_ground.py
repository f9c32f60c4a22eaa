"""What lies around a map: from an extract to polygons in the map's own metres."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
import shapely
from town import EAST, NORTH, Town

from tsbench.core.errors import InputError
from tsbench.make.maps.extracts import query
from tsbench.make.maps.ground import around, surfaces
from tsbench.make.maps.utm import UtmFrame

FRAME = UtmFrame(37)
MAP = SimpleNamespace(map_id="m", east=EAST + 100.0, north=NORTH + 50.0, half_w=30.0, half_h=20.0)


def square(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]


@pytest.fixture
def extract(tmp_path: Path) -> Path:
    """A house at the map, one far away, a shed too small to be seen, a park that leads out of the picture, a road."""
    town = Town()
    town.road([(0, 50), (200, 50)], "residential")
    for points, tags in (
        (square(110, 60, 10), {"building": "yes"}),
        (square(5000, 60, 10), {"building": "house"}),
        (square(90, 60, 2), {"building": "shed"}),
        (square(70, 60, 8), {"building": "no"}),
        (square(110, -900, 900), {"leisure": "park"}),
    ):
        town.ways.append(([town.node(*point) for point in points], tags))
    path = tmp_path / "town.osm"
    path.write_text(town.xml())
    return path


def test_surfaces_lie_where_they_are_in_metres(extract: Path) -> None:
    found = surfaces(extract, FRAME)
    assert sorted(kind for kind, _ in found) == ["building", "building", "building", "green"]
    built = [shape for kind, shape in found if kind == "building" and shape.bounds[0] < EAST + 999]
    house = max(built, key=lambda shape: shape.area)
    assert house.bounds == pytest.approx((EAST + 110, NORTH + 60, EAST + 120, NORTH + 70), abs=0.05)


def test_a_map_has_what_is_near_it_cut_in_its_own_frame(extract: Path) -> None:
    found = {kind: shapely.from_wkb(shape) for _, kind, shape in around([MAP], surfaces(extract, FRAME))}
    assert set(found) == {"building", "green"}
    assert found["building"].bounds == pytest.approx((10.0, 10.0, 20.0, 20.0), abs=0.11)
    # Of the park, what lies within 120 m of the box of the roads.
    assert found["green"].bounds == pytest.approx((10.0, -140.0, 150.0, -50.0), abs=0.11)


def test_what_is_no_extract_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "broken.osm"
    path.write_text("<osm version='0.6'><node")
    with pytest.raises(InputError, match="not a whole OSM file"):
        surfaces(path, FRAME)


def test_order_and_deleted_houses_are_as_in_roads(extract: Path, tmp_path: Path) -> None:
    lines = extract.read_text().splitlines()
    ways = [line for line in lines if line.startswith("<way")]
    others = [line for line in lines if not line.startswith("<way")]
    gone = [line.replace('version="1"', 'version="1" action="delete"') if "shed" in line else line for line in ways]
    path = tmp_path / "mixed.osm"
    path.write_text("\n".join([*others[:2], *gone, *others[2:]]))
    found, right = surfaces(path, FRAME), surfaces(extract, FRAME)
    small = min((shape for _, shape in right), key=lambda shape: shape.area)
    left = [shape for _, shape in right if not shape.equals(small)]
    assert [shape.equals(other) for (_, shape), other in zip(found, left, strict=True)] == [True] * 3


def test_overpass_is_asked_for_them_only_if_wanted() -> None:
    box = (7.0, 53.0, 7.1, 53.1)
    plain, more = query(box), query(box, ground=True)
    assert "building" not in plain
    assert 'wr["building"](53,7,53.1,7.1);' in more
    assert more.endswith(".ground; .ground >;);out body;")
