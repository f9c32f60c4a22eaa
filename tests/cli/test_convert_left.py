"""`tsbench maps convert` of a city with traffic on the left: its roads where they are, with traffic on the left."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml
from town import EAST, Town
from town_clone import NORTH, call, town_clone

from tsbench.make.maps.utm import UtmFrame
from tsbench.roads.network import RoadNetwork, read_network


def crossing(side: str) -> str:
    """Two roads that cross, and a ring that is driven as where traffic keeps to this side."""
    town = Town()
    town.road([(0, 0), (150, 0), (300, 0)], "residential")
    town.road([(150, -150), (150, 0), (150, 150)], "residential", lanes="2")
    angles = (-1.0 if side == "left" else 1.0) * np.radians(np.arange(0, 360, 15))
    ring = [(600 + 20 * float(np.cos(a)), 20 * float(np.sin(a))) for a in angles]
    town.road([*ring, ring[0]], "tertiary", junction="roundabout", oneway="yes")
    for x, y in ring[::6]:
        town.road([(x, y), (600 + 8 * (x - 600), 8 * y)], "tertiary")
    return town.xml(UtmFrame(32), NORTH)


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with town_clone(tmp_path_factory.mktemp("left")) as root:
        city = yaml.safe_load((root / "cities" / "nowhere.yaml").read_text())
        city |= {"city": "lefthand", "country": "gb", "side": "left", "types": "town.typ.xml"}
        (root / "cities" / "lefthand.yaml").write_text(yaml.safe_dump(city))
        for side in ("left", "right"):
            (root / f"{side}.osm").write_text(crossing(side), encoding="utf-8")
        yield root


def converted(clone: Path, capsys: pytest.CaptureFixture[str], side: str, city: str) -> RoadNetwork:
    out = clone / f"{side}.net.xml"
    said = call(capsys, "maps", "convert", "--city", city, str(clone / f"{side}.osm"), "--out", str(out))
    assert f"; traffic on the {side}" in said
    assert "lies in UTM zone" not in said
    return read_network(out)


@pytest.mark.parametrize(("side", "city", "sign"), [("left", "lefthand", 1.0), ("right", "nowhere", -1.0)])
def test_roads_are_where_they_are_and_traffic_on_its_side(
    side: str, city: str, sign: float, clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    network = converted(clone, capsys, side, city)
    # Eastwards on the road at this northing, the lane is north of the middle or south of it.
    aside = {lane.edge: float(np.median(lane.line.points[:, 1])) - NORTH for lane in network.lanes}
    assert sign * aside["501#0"] == pytest.approx(1.6, abs=0.5)
    assert sign * aside["-501#0"] == pytest.approx(-1.6, abs=0.5)
    text = (clone / f"{side}.net.xml").read_text()
    assert ('lefthand="true"' in text) is (side == "left")
    west, _, east, _ = map(float, re.findall(r'convBoundary="([^"]*)"', text)[0].split(","))
    assert (west, east) == pytest.approx((EAST, EAST + 760.0), abs=1.0)
    assert text.count("<roundabout ") == 1


def test_an_extract_of_elsewhere_is_said_to_be_one(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["maps", "convert", "--city", "elsewhere", str(clone / "left.osm"), "--out", str(clone / "x.net.xml")]
    said = call(capsys, *words)
    assert "lies in UTM zone 32, elsewhere in 33, and has the side and limits of elsewhere" in said
