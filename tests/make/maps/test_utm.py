"""Frames of extracts: every zone, both hemispheres, as PROJ has them and as netconvert chooses them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st
from town import EAST, NORTH, Town, make_town

from tsbench.core.errors import InputError
from tsbench.make.maps.harvest import _check_one_frame
from tsbench.make.maps.osm import contents_of
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.make.maps.utm import UtmFrame, frame_of, zones_at
from tsbench.scenarios.data_set import DataSet

ZONES = st.integers(1, 60)


@given(ZONES, st.booleans(), st.floats(-80.0, 84.0), st.floats(-4.0, 4.0))
def test_it_agrees_with_proj_in_all_zones_and_hemispheres(zone: int, south: bool, lat: float, off: float) -> None:
    """To a millimetre, a degree beyond the zone's edge too, and across the date line."""
    text = f"+proj=utm +zone={zone}{' +south' if south else ''} +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
    proj, frame = pyproj.Proj(text), frame_of(text, "x")
    lon = (6 * zone - 183 + off + 180.0) % 360.0 - 180.0
    east, north = proj(lon, lat)
    assert frame.to_metres(lat, lon).tolist() == pytest.approx([east, north], abs=1e-3)
    back = frame.to_degrees(east, north).tolist()
    assert back[0] == pytest.approx(lat, abs=1e-8)
    assert abs((back[1] - lon + 180.0) % 360.0 - 180.0) < 1e-7


@pytest.mark.parametrize(
    "projection",
    ["", "-", "!", "+proj=utm +zone=61 +ellps=WGS84", "+proj=utm +zone=0 +ellps=WGS84", "+proj=tmerc +lon_0=9",
     "+proj=utm +zone=37 +ellps=bessel"],
)  # fmt: skip
def test_another_projection_is_one_line(projection: str) -> None:
    with pytest.raises(InputError, match=r"town\.osm: netconvert used the projection"):
        frame_of(projection, "town.osm")


@given(ZONES)
def test_netconvert_is_told_the_zone_that_is_read_back(zone: int) -> None:
    assert frame_of(UtmFrame(zone).projection, "x") == UtmFrame(zone)


def test_zones_of_longitudes() -> None:
    found = {11.5: 32, 11.999: 32, 12.0: 33, -0.2: 30, 0.0: 31, 179.9: 60, 180.0: 1, -180.0: 1, 37.5: 37}
    assert dict(zip(found, zones_at(list(found)).tolist(), strict=True)) == found


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(("west", "zone"), [(450.0, 32), (150.0, 33)])
def test_a_town_on_a_zones_border_is_in_the_zone_of_most_of_it(
    west: float, zone: int, reverse: bool, workplace: Path, tmp_path: Path
) -> None:
    """Streets of 600 m, `west` of them before the border of the zones 32 and 33, whichever node comes first."""
    start = UtmFrame(32).to_metres(50.0, 12.0)[0].item() - EAST - west
    town = Town()
    for row in range(3):
        street = [(start + 50.0 * k, 100.0 * row) for k in range(13)]
        town.road(street[::-1] if reverse else street, "residential")
    name = f"border-{zone}-{reverse}"
    (tmp_path / f"{name}.osm").write_text(town.xml(UtmFrame(32), 5_540_000.0), encoding="utf-8")
    assert contents_of(tmp_path / f"{name}.osm").places.zone == zone
    source = load_source(DataSet(), name, tmp_path)
    assert source.frame == UtmFrame(zone)
    lon = source.frame.to_degrees(*source.node_xy.T)[:, 1]
    assert lon.min() < 12.0 < lon.max()


# Paris, a town on the equator's other side, one beside the date line: zone, northing of the town's origin.
PLACES = {"paris": (31, 5_411_000.0), "south": (35, -2_860_000.0), "date_line": (60, 5_000_000.0)}


@pytest.mark.parametrize("place", PLACES)
def test_the_same_town_elsewhere_is_the_same_network(
    place: str, tiny: SourceNetwork, osm_dir: Path, tmp_path: Path
) -> None:
    """Roads and signals lie where they lay in Moscow, to the decimetres that scale makes of a kilometre."""
    zone, north = PLACES[place]
    (tmp_path / f"{place}.osm").write_text(make_town().xml(UtmFrame(zone), north), encoding="utf-8")
    there = load_source(DataSet(), place, tmp_path)
    assert there.frame == UtmFrame(zone)
    assert there.edge_ids == tiny.edge_ids
    shift = np.array([0.0, north - NORTH])
    assert np.abs(there.node_xy - tiny.node_xy - shift).max() < 0.02
    assert len(there.signals) == len(tiny.signals) > 0
    assert np.abs(there.signals - tiny.signals - shift).max() < 0.02
    lat, lon = there.frame.to_degrees(EAST, north).tolist()
    assert lat == pytest.approx({"paris": 48.84, "south": -25.85, "date_line": 45.15}[place], abs=0.05)
    assert lon == pytest.approx({"paris": 1.77, "south": 26.1, "date_line": 175.85}[place], abs=0.05)


def test_extracts_outside_the_citys_zone_are_no_part_of_its_pool() -> None:
    _check_one_frame(DataSet(), {"a": UtmFrame(37), "b": UtmFrame(37)}, Path("osm"))
    with pytest.raises(InputError, match="osm: b is in UTM zone 31, moscow in UTM zone 37: one pool is of one"):
        _check_one_frame(DataSet(), {"a": UtmFrame(37), "b": UtmFrame(31)}, Path("osm"))


def test_roads_of_two_cities_are_refused_in_one_line(tmp_path: Path) -> None:
    town, far = make_town().xml(), make_town().xml(UtmFrame(37), NORTH + 500_000.0)
    body = far.split("\n", 2)[2].rsplit("</osm>", 1)[0]
    for tag in ("node id=", "way id=", "nd ref="):
        body = body.replace(f'{tag}"', f'{tag}"9')
    # Nodes come first in a file of OSM.
    nodes, ways = (
        "\n".join(line for line in (town + body).splitlines() if line.startswith(kind)) for kind in ("<node", "<way")
    )
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n{nodes}\n{ways}\n</osm>\n'
    (tmp_path / "two.osm").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"two\.osm: its roads lie 50\d km apart, more than one city"):
        load_source(DataSet(), "two", tmp_path)
