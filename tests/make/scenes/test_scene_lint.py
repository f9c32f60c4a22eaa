"""Each lint finds its fault, and a sound scene has none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lxml import etree
from simworld import SceneMaker, edge, loader_of, obstacle, place, plain, plate

from tsbench.make.maps.plain import PlainNode
from tsbench.make.scenes.traffic import Car
from tsbench.make.scenes.verify import lint_limits, lint_scene
from tsbench.roads.lane_graph import Destination
from tsbench.roads.planner_map import build_planner_map
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import EgoStart, Obstacle

START, END = EgoStart("ta_0", 60.0, 8.0), Destination("bu", 60.0)
WAY, ROUND = ("ta", "ab", "bu"), ("ta", "ad", "dc", "cb", "bu")


def problems(
    made: SceneMaker, start: EgoStart = START, end: Destination = END,
    route: Sequence[str] = WAY, sign: SignInstance | None = None, compliant: Sequence[str] = (),
    cars: Sequence[Car] = (), obstacles: Sequence[Obstacle] = (), convoy_at: tuple | None = None,
) -> list[str]:  # fmt: skip
    def add_compliant(elements: list[etree._Element]) -> None:
        point = next(e for e in elements if e.get("id") == "start")
        etree.SubElement(point, "param", key="compliant", value=" ".join(compliant))

    spec = made.make(
        "linted", start, end, route, sign or plate(made.network, "ta", 139.0), cars=cars, obstacles=obstacles,
        convoy_at=convoy_at, change=add_compliant if compliant else None,
    )  # fmt: skip
    scene, roads = loader_of(made.root).load(spec)
    return list(lint_scene(scene, roads.graph))


def test_a_sound_scene_has_no_problem(on_block: SceneMaker) -> None:
    cars = [Car("bg_000", 0, 0.0, ("ab", "bu"), 0, 50.0), Car("bg_001", 0, 3.0, WAY, 0, None)]
    beside = obstacle(on_block.network, "ta_1", 100.0)
    convoy = ("ba_0", (100.0, 90.0), ("ba", "at"))
    assert problems(on_block, compliant=ROUND, cars=cars, obstacles=[beside], convoy_at=convoy) == []


@pytest.mark.parametrize("s", [1.0, 141.5])
def test_an_ego_over_the_end_of_its_lane(on_block: SceneMaker, s: float) -> None:
    assert any("the ego starts" in p for p in problems(on_block, EgoStart("ta_0", s, 0.0)))


@pytest.mark.parametrize(
    ("scene", "problem"),
    [
        ({"end": Destination("bu", 150.0)}, "the destination is 150.0 m along an edge of 142.8 m"),
        ({"end": Destination("ub", 60.0)}, "no way from start to destination"),
        ({"route": ROUND}, "navigation gives another way than the scene says"),
        ({"compliant": ("ta", "ab", "bc", "cd")}, "the obedient way is not the one that the scene says"),
        ({"route": ("ta", "bu")}, "the way of navigation has no lanes that connect"),
    ],
)
def test_a_way_that_is_none(on_block: SceneMaker, scene: dict[str, Any], problem: str) -> None:
    assert problem in problems(on_block, **scene)


def test_a_destination_behind_the_ego(on_block: SceneMaker) -> None:
    found = problems(on_block, end=Destination("ta", 20.0), route=("ta",))
    assert any("destination" in p for p in found)


@pytest.mark.parametrize(("degrees", "sharp"), [(60, False), (-90, False), (140, True), (-140, True)])
def test_a_bend_that_no_car_can_take(tmp_path: Path, degrees: float, sharp: bool) -> None:
    turn = math.radians(degrees)
    a, b = PlainNode("a", 0.0, 0.0), PlainNode("b", 150.0, 0.0)
    c = PlainNode("c", 150.0 + 100.0 * math.cos(turn), 100.0 * math.sin(turn))
    made = SceneMaker.over(plain([a, b, c], [edge(a, b), edge(b, c)]), tmp_path)
    found = problems(
        made, EgoStart("ab_0", 60.0, 5.0), Destination("bc", 50.0), ("ab", "bc"), plate(made.network, "ab", 100.0)
    )
    assert any("the way of navigation turns by" in p for p in found) is sharp


def moved(made: SceneMaker, side: float) -> SignInstance:
    """The plate so far right of the road's right edge."""
    sign = plate(made.network, "ta", 100.0)
    x, y, _ = place(made.network, "ta_0", 100.0, -(1.6 + side))
    return replace(sign, x=x, y=y)


@pytest.mark.parametrize("side", [-8.0, -3.2, 0.0, 0.4, 1.2, 2.9, 3.5])
def test_a_plate_on_the_wrong_side_in_the_lane_or_far_away(on_block: SceneMaker, side: float) -> None:
    problem = f"plate sign_0 stands {side:.1f} m right of its road's edge"
    assert problems(on_block, sign=moved(on_block, side)) == ([] if 0.0 < side < 3.0 else [problem])


@pytest.mark.parametrize("turn", [20.0, 90.0, 180.0, -170.0])
def test_a_plate_that_faces_the_wrong_way(on_block: SceneMaker, turn: float) -> None:
    sign = plate(on_block.network, "ta", 100.0)
    turned = replace(sign, heading=sign.heading + math.radians(turn))
    assert problems(on_block, sign=turned) == ["plate sign_0 does not face its lane"]


def test_a_plate_elsewhere_along_the_road(on_block: SceneMaker) -> None:
    sign = replace(plate(on_block.network, "ta", 100.0), position_m=97.0)
    assert problems(on_block, sign=sign) == ["plate sign_0 stands 100.0 m along its lane, not 97.0 m"]


def test_a_plate_on_its_obstacle(on_block: SceneMaker) -> None:
    island = obstacle(on_block.network, "ta_1", 102.0)
    x, y, heading = place(on_block.network, "ta_1", 99.6)
    sign = replace(plate(on_block.network, "ta", 99.6), x=x, y=y, heading=heading, lane=1)
    assert problems(on_block, sign=sign, obstacles=[island]) == []


def test_an_obstacle_off_its_lane(on_block: SceneMaker) -> None:
    on = obstacle(on_block.network, "ta_1", 100.0)
    x, y, _ = place(on_block.network, "ta_1", 100.0, 0.5)
    for off in (replace(on, x=x, y=y), replace(on, lane="ta_0"), obstacle(on_block.network, "ta_1", 141.5)):
        assert "obstacle obstacle_0 does not stand on its lane" in problems(on_block, obstacles=[off])


@pytest.mark.parametrize("front", [57.0, 60.0, 62.2, 66.7])
def test_a_car_inside_the_ego(on_block: SceneMaker, front: float) -> None:
    cars = [Car("bg_000", 0, 0.0, WAY, 0, front)]
    found = problems(on_block, cars=cars)
    gap = abs(front - 2.25 - 60.0) - (4.5 + 4.515) / 2
    assert found == (["ego and bg_000 start in the same place"] if gap < 0 else [])


def test_bodies_inside_each_other(on_block: SceneMaker) -> None:
    cars = [Car("bg_000", 0, 0.0, ("ab", "bu"), 0, 50.0), Car("bg_001", 0, 0.0, ("ab", "bu"), 0, 53.0)]
    assert problems(on_block, cars=cars) == ["bg_000 and bg_001 start in the same place"]
    late = [cars[0], replace(cars[1], depart=20.0)]
    assert problems(on_block, cars=late) == []
    cones = obstacle(on_block.network, "ab_0", 48.0)
    assert "obstacle_0 and bg_000 start in the same place" in problems(on_block, cars=cars[:1], obstacles=[cones])
    convoy = ("ab_0", (51.0,), ("ab", "bu"))
    assert "convoy_0 and bg_000 start in the same place" in problems(on_block, cars=cars[:1], convoy_at=convoy)


def test_the_limit_that_judges_is_the_one_on_the_map(on_block: SceneMaker) -> None:
    """Whatever SUMO's own limits are; a view of other classes' limits is told."""
    network = on_block.network
    edges = {name: replace(one, road_class="street") for name, one in network.edges.items()}
    classed = replace(network, edges=edges, class_speed={"street": 9.0})
    assert set(classed.shown_limits) == {9.0}
    assert {lane.speed for lane in classed.lanes} != {9.0}
    assert list(lint_limits(classed, build_planner_map(classed))) == []
    found = list(lint_limits(classed, build_planner_map(network)))
    assert any(line.startswith("lane ta_0 is judged by 9.00 m/s, the map shows ") for line in found)


def test_a_way_over_a_junction_has_the_lower_limit(on_block: SceneMaker) -> None:
    network = on_block.network
    edges = {name: replace(one, road_class="slow" if name == "ab" else "fast") for name, one in network.edges.items()}
    classed = replace(network, edges=edges, class_speed={"slow": 5.0, "fast": 20.0})
    (link,) = (c for c in classed.outgoing[classed.lane_index["ta_0"]] if classed.lanes[c.to_lane].edge == "ab")
    assert [classed.shown_limits[k] for k in (link.from_lane, *link.via, link.to_lane)] == [20.0, 5.0, 5.0]
