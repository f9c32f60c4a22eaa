"""Plate 8.13: read from the plates that stand before a junction."""

from __future__ import annotations

import math

import pytest

from tsbench.core.paths import MIRRORED, OWN_CITY
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.sim.main_road import MainRoad, main_roads
from tsbench.sim.scene import Scene


def scene_of(kind: str, half: str) -> Scene:
    """The first one of a type and half."""
    table = DataSet().table("dev")
    return load_scene(DataSet(), next(row for row in table if (row.scenario_type, row.half) == (kind, half)))


def test_a_main_road_that_turns_has_its_shape_beneath_each_plate() -> None:
    """In `main_road` it comes from the ego and leads to its right, where the convoy comes from."""
    scene = scene_of("main_road", "signed")
    found = main_roads(scene.network, scene.signs)
    target = found[scene.targets[0]]
    assert 180 in target.main
    (right,) = (angle for angle in target.main if angle != 180)
    assert -150 <= right <= -30
    assert target.told == (math.radians(right), math.pi)
    assert target.others
    assert all(-30 <= angle <= 150 for angle in target.others)
    for other in (s for s in scene.signs if s.code == "2.1" and s.id not in scene.targets):
        (left,) = (angle for angle in found[other.id].main if angle != 180)
        assert left == pytest.approx(-right, abs=15)


@pytest.mark.parametrize(("kind", "half"), [("yield", "signed"), ("stop", "signed"), ("main_road", "contrast")])
def test_a_main_road_that_goes_straight_on_or_ends_has_none(kind: str, half: str) -> None:
    scene = scene_of(kind, half)
    assert any(sign.code == "2.1" for sign in scene.signs)
    assert main_roads(scene.network, scene.signs) == {}


def test_the_mirror_image_turns_the_other_way() -> None:
    scene = scene_of("main_road", "signed")
    town = DataSet.named(f"{MIRRORED}{OWN_CITY}")
    table = town.table("dev")
    row = next(row for row in table if (row.scenario_type, row.half) == ("main_road", "signed"))
    mirrored = load_scene(town, row)
    here, there = (main_roads(s.network, s.signs)[scene.targets[0]].main for s in (scene, mirrored))
    assert sorted(there) == sorted(180 if angle == 180 else -angle for angle in here)
    assert here != there


def test_a_name_stands_for_its_roads() -> None:
    road = MainRoad((180, -90), (0, 90))
    assert MainRoad.of(road.key) == road
    with pytest.raises(ValueError, match="no main road"):
        MainRoad.of("3.24|40")
