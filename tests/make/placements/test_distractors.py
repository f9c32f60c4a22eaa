"""Posts that bind nobody who is watched: the same plates in both halves of a pair, and what stands there besides."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pool_builders import built_site, corridor, crossroads, recipe_of, two_way
from simworld import FAST, cross_plain, loader_of, road_plain
from test_route_scenes import TYPES, ways

from tsbench.core.benchmark import SIGN_RANGE_M
from tsbench.make.maps.plain import PlainNet
from tsbench.make.scenes.plate_surroundings import CLOSING
from tsbench.make.scenes.verify import lint_places
from tsbench.roads.lane_graph import LaneGraph
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.sim.scene import Scene

# The other half's plates hang at a place behind the destination.
BEHIND = ("crosswalk", "zone_speed_limit", "residential_zone")
AT_LINE = ("yield", "stop", "secondary_road", "main_road")
CROSS = (crossroads(), cross_plain())
ONE_WAY = (corridor(speed=FAST, length=240.0), road_plain(240.0, speed=FAST))
LONG = (corridor(speed=FAST), road_plain(speed=FAST))
MAPS = {
    **dict.fromkeys((*AT_LINE, "blocked_road"), CROSS),
    **dict.fromkeys(("speed_limit", "min_speed", "crosswalk", "bus_lane", "bike_lane"), two_way()),
    "zone_speed_limit": two_way("tertiary"),
    "residential_zone": two_way("residential", 40.0 / 3.6),
    **dict.fromkeys(("detour_left", "detour_right"), LONG),
}


ScenesOf = Callable[[str, tuple[PoolRow, PlainNet]], list[Scene]]


@pytest.fixture(scope="module")
def scenes_of(tmp_path_factory: pytest.TempPathFactory) -> ScenesOf:
    """The scenes of a map's first four variants, signed and contrast in turn; each site is built once."""
    built: dict[tuple[str, PoolRow], list[Scene]] = {}

    def scenes(type_id: str, made: tuple[PoolRow, PlainNet]) -> list[Scene]:
        if (type_id, made[0]) not in built:
            built[type_id, made[0]] = build(type_id, made, tmp_path_factory.mktemp(type_id))
        return built[type_id, made[0]]

    return scenes


def build(type_id: str, made: tuple[PoolRow, PlainNet], root: Path) -> list[Scene]:
    # Of a blocked road the two arms that stay open have no room for more traffic.
    most = 3.0 if type_id == "blocked_road" else math.inf
    site = built_site(
        recipe_of(type_id), root, made, lambda all_: [v for v in all_ if v.density < most][:4], split="train"
    )
    assert site.reason == ""
    loader = loader_of(root)
    return [loader.load(spec)[0] for spec in site.rows]


def plates(scene: Scene) -> list[tuple[str, float]]:
    return sorted((sign.code, sign.value or 0.0) for sign in scene.signs)


def posts(scene: Scene) -> list[tuple[float, float, float]]:
    return [(sign.x, sign.y, sign.heading) for sign in scene.signs]


def behind(scene: Scene) -> list[SignInstance]:
    """Plates on the ego's own edge that it has passed before its start, in the order in which it did."""
    edge_id = scene.network.lane(scene.start.lane).edge
    passed = [s for s in scene.signs if s.edge == edge_id and s.position_m < scene.start.s]
    return sorted(passed, key=lambda sign: sign.position_m)


@pytest.mark.parametrize("type_id", MAPS)
def test_both_halves_have_the_same_plates(type_id: str, scenes_of: ScenesOf) -> None:
    """On the same posts, in another order, so that only who relates a plate to its place can tell the halves apart."""
    scenes = scenes_of(type_id, MAPS[type_id])
    for signed, contrast in zip(scenes[::2], scenes[1::2], strict=True):
        assert plates(signed) == plates(contrast)
        assert posts(signed) == posts(contrast)
        way = signed.network.lane(signed.start.lane).line
        at_line = [way.length] if type_id in AT_LINE else []
        seen_from = [way.point_at(s) for s in (signed.start.s, *at_line)]
        ways = {*signed.route_hint, *signed.compliant_hint}
        for one, other in zip(signed.signs, contrast.signs, strict=True):
            if one.role == other.role == DISTRACTOR and (one.code, one.value) != (other.code, other.value):
                assert (one.params, other.params) == (None, None)
                if type_id in BEHIND:
                    continue
                away = max(math.dist(place, (one.x, one.y)) for place in seen_from)
                assert away < SIGN_RANGE_M or load_catalog().sign(one.code).is_end
                assert one.edge not in ways or one in behind(signed)


@pytest.mark.parametrize("type_id", ["zone_speed_limit", "residential_zone"])
def test_backs_of_a_zones_plates_look_alike_in_both_halves(type_id: str, scenes_of: ScenesOf) -> None:
    """What faces others is seen by its outline alone."""
    scenes, signs = scenes_of(type_id, MAPS[type_id]), load_catalog().signs
    outlines = [[signs[s.code].outline for s in scene.signs] for scene in scenes]
    assert outlines[::2] == outlines[1::2]


def test_no_end_in_sight_tells_which_limit_binds(scenes_of: ScenesOf) -> None:
    """Wherever the ego is before the plate, the same plates are in sight in both halves."""
    scenes = scenes_of("speed_limit", MAPS["speed_limit"])
    for signed, contrast in zip(scenes[::2], scenes[1::2], strict=True):
        line = signed.network.lane(signed.start.lane).line
        places = [line.point_at(s) for s in np.arange(signed.start.s, line.length, 0.5).tolist()]
        assert in_sight(signed, places[0]) == in_sight(contrast, places[0])
        assert all(in_sight(signed, at) == in_sight(contrast, at) for at in places)


def in_sight(scene: Scene, at: tuple[float, float]) -> list[tuple[str, float]]:
    return sorted((s.code, s.value or 0.0) for s in scene.signs if math.dist(at, (s.x, s.y)) <= SIGN_RANGE_M)


@pytest.mark.parametrize("type_id", MAPS)
def test_plates_stand_where_they_can_and_are_kept(type_id: str, scenes_of: ScenesOf) -> None:
    """No plate of either half stands where it cannot, and no vehicle breaks one."""
    for scene in scenes_of(type_id, MAPS[type_id]):
        assert [str(f) for f in lint_places(scene, LaneGraph(scene.network))] == []
        # Roads that lanes lead into are closed by no other plate than the target and its counterpart.
        closing = [s for s in scene.signs if s.code in CLOSING]
        assert len(closing) <= (1 if type_id in ("blocked_road", "no_entry") else 0)


@pytest.mark.parametrize("type_id", ["direction_straight", "no_turn_left"])
def test_counterparts_of_turns_stand_at_lines_and_are_kept(type_id: str, scenes_of: ScenesOf) -> None:
    """A second junction is near: there the other half's plate regulates an approach, and traffic turns as both say."""
    scenes = scenes_of(type_id, ways(*TYPES[type_id]))
    found = [f for scene in scenes for f in lint_places(scene, LaneGraph(scene.network))]
    assert [str(f) for f in found if f.role == DISTRACTOR] == []
