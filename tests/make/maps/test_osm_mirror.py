"""What left and right become in a mirror, and that nothing is lost there and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import osmium
import pytest
from hypothesis import given
from hypothesis import strategies as st
from town import NORTH, make_town

from tsbench.make.maps.osm import read_extract
from tsbench.make.maps.road_tags import mirrored_tags
from tsbench.make.maps.utm import UtmFrame

MERIDIAN = UtmFrame(37).meridian


@pytest.mark.parametrize(
    ("key", "value", "image"),
    [
        ("turn:lanes", "left|through|through;right", ("turn:lanes", "left;through|through|right")),
        ("turn:lanes:forward", "sharp_left||none", ("turn:lanes:forward", "none||sharp_right")),
        ("bus:lanes", "designated|yes|yes", ("bus:lanes", "yes|yes|designated")),
        ("destination:lanes", "A 4;Left Bank|B", ("destination:lanes", "B|A 4;Left Bank")),
        ("change:lanes", "not_left|no", ("change:lanes", "no|not_right")),
        ("lanes:backward", "2", ("lanes:backward", "2")),
        ("restriction", "no_left_turn", ("restriction", "no_right_turn")),
        ("restriction", "only_straight_on", ("restriction", "only_straight_on")),
        ("sidewalk", "left", ("sidewalk", "right")),
        ("sidewalk:left:surface", "gravel", ("sidewalk:right:surface", "gravel")),
        ("parking:both", "lane", ("parking:both", "lane")),
        ("name", "Left Bank left", ("name", "Left Bank left")),
        ("name:left", "A", ("name:right", "A")),
        ("highway", "leftover", ("highway", "leftover")),
    ],
)
def test_tags_tell_of_the_image(key: str, value: str, image: tuple[str, str]) -> None:
    found = mirrored_tags([(key, value)])
    # Turns within a lane have no order.
    ours = {k: "|".join(";".join(sorted(lane.split(";"))) for lane in v.split("|")) for k, v in found.items()}
    theirs = "|".join(";".join(sorted(lane.split(";"))) for lane in image[1].split("|"))
    assert ours == {image[0]: theirs}


@given(st.dictionaries(st.text("leftrigh_:|lanes ", max_size=12), st.text("leftrigh_:|; ", max_size=12)))
def test_twice_is_what_it_was(tags: dict[str, str]) -> None:
    once = mirrored_tags(tags.items())
    if len(once) == len(tags):
        assert mirrored_tags(once.items()) == tags


def test_the_placement_of_a_line_is_left_out() -> None:
    assert mirrored_tags([("placement", "right_of:1"), ("placement:forward", "middle_of:1")]) == {}


def test_an_extract_comes_back_from_the_second_mirror(tmp_path: Path) -> None:
    path, once, twice, plain = (tmp_path / f"{name}.osm" for name in ("town", "once", "twice", "plain"))
    path.write_text(make_town().xml(), encoding="utf-8")
    facts = read_extract(path, once, in_mirror=True)
    read_extract(once, twice, in_mirror=True)
    straight = read_extract(path, plain)
    assert twice.read_bytes() == plain.read_bytes() != once.read_bytes()
    # Signals are told where they are.
    assert np.array_equal(facts.signals, straight.signals)
    for one, other in zip(osmium.FileProcessor(str(path)), osmium.FileProcessor(str(once)), strict=True):
        if one.is_node():
            assert one.location.lat == other.location.lat
            assert one.location.lon + other.location.lon == pytest.approx(2 * MERIDIAN, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-70.0, 70.0), st.integers(1, 60))
def test_a_frame_in_a_mirror_keeps_degrees_true(off: float, lat: float, zone: int) -> None:
    true, image = UtmFrame(zone, lat < 0.0), UtmFrame(zone, lat < 0.0, mirrored=True)
    lon = true.meridian + off
    east, north = image.to_metres(lat, lon).tolist()
    assert image.to_degrees(east, north).tolist() == pytest.approx([lat, lon], abs=1e-8)
    assert (image.true_east(east), north) == pytest.approx(tuple(true.to_metres(lat, lon).tolist()), abs=1e-6)
    assert image.to_metres(lat, true.meridian - off)[0] == pytest.approx(true.to_metres(lat, lon)[0], abs=1e-6)


def test_a_british_town_has_the_roads_of_its_image(tmp_path: Path) -> None:
    """Its ring goes round clockwise; read in the mirror it is the town that keeps to the right."""
    right, left = tmp_path / "right.osm", tmp_path / "left.osm"
    right.write_text(make_town().xml(), encoding="utf-8")
    left.write_text(make_town().xml(UtmFrame(37, mirrored=True), NORTH), encoding="utf-8")
    image, plain = tmp_path / "image.osm", tmp_path / "plain.osm"
    read_extract(left, image, in_mirror=True)
    read_extract(right, plain)
    for one, other in zip(osmium.FileProcessor(str(plain)), osmium.FileProcessor(str(image)), strict=True):
        assert one.id == other.id
        if one.is_node():
            here, there = one.location, other.location
            assert (here.lat, here.lon) == pytest.approx((there.lat, there.lon), abs=2e-7)
        else:
            assert [node.ref for node in one.nodes] == [node.ref for node in other.nodes]
