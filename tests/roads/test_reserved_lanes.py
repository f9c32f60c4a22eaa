"""Lanes that plates reserve: how navigation, the lane locator and SUMO see an ego on them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from labelled import CASES
from lxml import etree
from simworld import CALM, SceneMaker, motion_at, plate

from tsbench.make.scenes.traffic import convoy_elements
from tsbench.roads.lane_graph import Destination, LaneGraph, RoutePath
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.roads.reserved_lanes import contraflow_lanes, open_lanes
from tsbench.sim.navigation import Navigator
from tsbench.sim.scene import EgoStart
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import ActorKind, EgoState

NETS = CASES / "nets"
BUS = replace(CALM, speed=8.5, length=12.0, width=2.55)


@pytest.fixture(scope="module")
def same() -> RoadNetwork:
    """ab, bc, cd with two lanes each; the right one of bc is for buses and cyclists."""
    return read_network(NETS / "reserved.net.xml")


@pytest.fixture(scope="module")
def contra() -> RoadNetwork:
    """ab with three lanes; behind it bc with two and, the other way round, cb for buses and cyclists."""
    return read_network(NETS / "contraflow.net.xml")


def lanes_of(network: RoadNetwork, path: RoutePath | None) -> list[str]:
    return [lane.id for p in path.pieces if not (lane := network.lanes[p.lane]).internal]


def state(network: RoadNetwork, locator: LaneLocator, x: float, y: float, heading: float, last: int) -> EgoState:
    lane, s, d, on_road = locator.locate(x, y, heading, last)
    return EgoState(x, y, heading, 8.0, 0.0, 0.0, 0.0, lane, s, d, on_road)


def test_navigation_stays_in_a_lane_that_a_plate_reserves(same: RoadNetwork) -> None:
    graph, start = LaneGraph(same), same.lane("ab_0").index
    route = graph.route("ab", "cd")
    assert route == ("ab", "bc", "cd")
    path = graph.path(route, start, 10.0, Destination("cd", 50.0))
    assert lanes_of(same, path) == ["ab_0", "bc_0", "cd_0"]
    # Who may not use it, by the network, is a car all the same.
    assert not same.lane("bc_0").permits("passenger")


def test_closed_lanes_are_left_in_time(same: RoadNetwork, contra: RoadNetwork) -> None:
    graph = LaneGraph(same, closed={same.lane("bc_0").index})
    path = graph.path(("ab", "bc", "cd"), same.lane("ab_0").index, 10.0, Destination("cd", 50.0))
    assert lanes_of(same, path)[1:] == ["ab_1", "bc_1", "cd_1"] or lanes_of(same, path) == [
        "ab_1",
        "ab_1",
        "bc_1",
        "cd_1",
    ]
    graph = LaneGraph(contra, closed={contra.lane("cb_0").index})
    path = graph.path(("ab", "bc"), contra.lane("ab_2").index, 10.0, Destination("bc", 50.0))
    assert set(lanes_of(contra, path)) == {"ab_1", "bc_1"}


def test_navigation_goes_straight_on_into_a_contraflow_lane(contra: RoadNetwork) -> None:
    graph, start = LaneGraph(contra), contra.lane("ab_2")
    assert graph.route("ab", "bc") == ("ab", "bc")
    assert graph.route("cb", "bc") is None  # no way for cars begins there
    path = graph.path(("ab", "bc"), start.index, 10.0, Destination("bc", 60.0))
    assert path is not None
    assert lanes_of(contra, path) == ["ab_2", "cb_0"]
    assert path.line.heading_at(path.line.length - 5.0) == pytest.approx(0.0, abs=1e-6)
    assert {round(y, 3) for _, y in path.line.points.tolist()} == {-1.6}
    # The destination is beside where it is on the lanes for cars.
    x, _ = path.line.point_at(path.destination_s)
    assert x == pytest.approx(contra.edge_lanes("bc")[0].line.point_at(60.0)[0], abs=0.01)
    turned = contra.lane("cb_0").index
    assert (graph.edge_of(turned), graph.order_of(turned)) == ("bc", 2)
    assert graph.line_of(turned).point_at(0.0) == pytest.approx(contra.lane("cb_0").line.points[-1])


def test_from_inside_the_contraflow_lane_the_way_leads_on(contra: RoadNetwork) -> None:
    graph, lane = LaneGraph(contra), contra.lane("cb_0")
    path = graph.path(("bc",), lane.index, 30.0, Destination("bc", 60.0))
    assert path.line.point_at(0.0) == pytest.approx(lane.line.point_at(30.0))
    assert path.line.point_at(10.0)[0] == pytest.approx(lane.line.point_at(30.0)[0] + 10.0)


def test_ordinary_networks_have_no_such_lanes(block: RoadNetwork, cross: RoadNetwork) -> None:
    for network in (block, cross):
        ordinary = {lane.index for lane in network.lanes if not lane.internal}
        assert open_lanes(network) == ordinary
        assert contraflow_lanes(network) == {}


def test_a_lane_for_cars_that_comes_the_other_way_is_no_continuation(contra: RoadNetwork) -> None:
    lanes = tuple(replace(lane, allow=frozenset()) if lane.id == "cb_0" else lane for lane in contra.lanes)
    assert contraflow_lanes(replace(contra, lanes=lanes)) == {}


def test_navigation_of_an_ego_that_keeps_straight_on(contra: RoadNetwork) -> None:
    """The route stands all the way, across the plate and against the lane's own direction."""
    graph, locator = LaneGraph(contra), LaneLocator(contra)
    navigator, last, paths = Navigator(graph, Destination("bc", 80.0)), contra.lane("ab_2").index, set()
    remaining = math.inf
    for k in range(160):
        ego = state(contra, locator, 10.0 + k, -1.6, 0.0, last)
        last = ego.lane
        view = navigator.update(ego)
        paths.add(id(view.path))
        assert ego.on_road
        assert abs(view.d) < 0.01
        assert view.remaining < remaining
        remaining = view.remaining
    assert len(paths) == 1
    assert contra.lanes[last].id == "cb_0"


def test_the_locator_finds_the_lane_of_an_ego_that_drives_against_it(contra: RoadNetwork) -> None:
    locator = LaneLocator(contra)
    for x in (104.5, 130.0, 199.0):
        lane, s, d, on_road = locator.locate(x, -1.4, 0.0, -1)
        assert (contra.lanes[lane].id, on_road) == ("cb_0", True)
        assert s == pytest.approx(200.0 - x)
        assert d == pytest.approx(-0.2)


def test_between_the_directions_of_a_road_there_is_no_slit(contra: RoadNetwork) -> None:
    lanes = tuple(
        replace(lane, width=lane.width - 0.2) if lane.id in ("cb_0", "bc_1") else lane for lane in contra.lanes
    )
    locator = LaneLocator(replace(contra, lanes=lanes))
    assert locator.locate(150.0, -3.2, 0.0, -1)[3]
    # Beside the road there is none either, but no lane.
    assert not locator.locate(150.0, 0.1, 0.0, -1)[3]


def _with_bus(lane: str, place: float) -> list[etree._Element]:
    return convoy_elements([BUS], [(place, 0, [lane.rsplit("_", 1)[0]])], "bus")


@pytest.mark.parametrize(
    ("net", "start", "lane", "s", "bus_at", "route", "heading"),
    [
        ("reserved", "ab_0", "bc_0", 60.0, 20.0, ("ab", "bc"), 0.0),
        ("contraflow", "ab_2", "cb_0", 60.0, 20.0, ("ab", "bc"), math.pi),
    ],
)
def test_sumo_sees_an_ego_on_a_lane_that_it_may_not_use(
    sim: Simulation, tmp_path: Path, net: str, start: str, lane: str, s: float, bus_at: float,
    route: tuple[str, ...], heading: float,
) -> None:  # fmt: skip
    """A bus behind it, or coming towards it, brakes; SUMO neither breaks off nor takes anybody out."""
    network = read_network(NETS / f"{net}.net.xml")
    path = tmp_path / f"{net}.net.xml"
    path.write_bytes((NETS / f"{net}.net.xml").read_bytes())
    maker = SceneMaker(tmp_path, path, network)
    spec = maker.make(
        "scene", EgoStart(start, 30.0, 8.0), Destination("bc", 60.0), route, plate(network, "bc", 0.0),
        change=lambda elements: elements.extend(_with_bus(lane, bus_at)),
    )  # fmt: skip
    sim.load(path, maker.path(spec), network, 7)
    first = motion_at(network, start, 30.0, 8.0)
    sim.start_ego(first, start[:-2], int(start[-1]))
    sim.hold("convoy_0")  # for good in its lane
    sim.release("convoy_0")
    there = motion_at(network, lane, s)
    standing = replace(there, heading=there.heading + heading, speed=0.0)
    for _ in range(250):
        sim.place_ego(standing, lane[:-2], int(lane[-1]))
        sim.step()
    actors = sim.actors()
    assert actors is not None
    where = {name: (on, at) for name, on, at, *_ in sim.fleet()}
    assert where["ego"][0] == lane
    on, at = where["convoy_0"]
    assert on == lane
    assert at < s - 2.0
    k = actors.table.ids.index("convoy_0")
    assert float(actors.speed[actors.index.tolist().index(k)]) == pytest.approx(0.0, abs=0.05)
    assert actors.table.kind[k] == ActorKind.BUS
    assert (actors.table.length[k], actors.table.width[k]) == (12.0, 2.55)
