from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from labelled import network
from simworld import SceneMaker, edge, plain

from tsbench.make.maps.plain import PlainNode
from tsbench.roads.network import RoadNetwork
from tsbench.rules import lines
from tsbench.rules.lines import reverse_edges
from tsbench.sim.world import EGO_LENGTH_M, EgoState

HALF = EGO_LENGTH_M / 2
SIDEWAYS = math.radians(60)  # of the ego's half length, half is along the road

BESIDE_WIDTHS = 2.0


def road_over(net: RoadNetwork, edges: tuple[str, ...], order: int = 0) -> lines.Road:
    return lines.Road(net, edges, order, beside_widths=BESIDE_WIDTHS)


def approach_line(net: RoadNetwork, edge: str) -> lines.ApproachLine:
    return lines.ApproachLine(net, edge, BESIDE_WIDTHS)


def _on(net: RoadNetwork, lane: str, s: float, turn: float = 0.0) -> EgoState:
    """An ego with its centre on a lane's middle, turned off its direction (rad)."""
    index, line = net.lane_index[lane], net.lane(lane).line
    x, y = line.point_at(s)
    return EgoState(x, y, line.heading_at(s) + turn, 5.0, 0.0, 0.0, 0.0, index, s, 0.0, True)


def _off(x: float, y: float, heading: float = 0.0) -> EgoState:
    """An ego on no lane."""
    return EgoState(x, y, heading, 5.0, 0.0, 0.0, 0.0, -1, 0.0, 0.0, False)


def _about(value: float) -> Any:
    return pytest.approx(value, abs=1e-6)


def test_the_other_direction_of_a_road() -> None:
    assert reverse_edges(network("corridor"), "ab") == (("ba",), ("ab",))
    assert reverse_edges(network("corridor"), "ba") == (("ab",), ("ba",))
    assert reverse_edges(network("contraflow"), "ab") == ((), ("ab",))
    assert reverse_edges(network("contraflow"), "bc") == (("cb",), ("bc",))
    assert reverse_edges(network("forks"), "l33") == (("l33_in",), ("l33",))


def test_who_drives_on_the_wrong_side_of_a_road_that_is_cut_is_on_it(tmp_path: Path) -> None:
    """Plates cut one direction; the other one is whole, and leads past their zone."""
    places = {"a": 0.0, "m": 100.0, "n": 150.0, "b": 250.0}
    nodes = {k: PlainNode(k, x, 0.0) for k, x in places.items()}
    own = [edge(nodes[p[0]], nodes[p[1]], name=f"ab.{k}") for k, p in enumerate(("am", "mn", "nb"))]
    back = edge(nodes["b"], nodes["a"])
    net = SceneMaker.over(plain(list(nodes.values()), [*own, back]), tmp_path).network
    assert lines.cut_road(net, "ab.1") == ("ab.0", "ab.1", "ab.2")
    assert reverse_edges(net, "ab.1") == (("ba",), ("ab.0", "ab.1", "ab.2"))
    zone = road_over(net, ("ab.1",))
    x0 = net.lane("ab.1_0").line.point_at(0.0)[0]
    for x in (60.0, 110.0, 140.0, 200.0):
        wrong = _on(net, "ba_0", net.lane("ba_0").line.project(x, 0.0)[0], math.pi)
        assert zone.front(wrong) == pytest.approx(x + HALF - x0, abs=1.0)
        assert zone.front(_on(net, "ba_0", 250.0 - x)) is None, "who drives there as is due is not on it"
    assert approach_line(net, "ab.2").to_go(_on(net, "ba_0", 20.0, math.pi)) == pytest.approx(20.0 - HALF)


def test_pieces_in_a_loop_and_contraflows_are_no_cut_road(tmp_path: Path) -> None:
    nodes = {k: PlainNode(k, x, y) for k, x, y in (("a", 0.0, 0.0), ("m", 100.0, 0.0), ("b", 200.0, 40.0))}
    pairs = {"ab.0": "am", "ab.1": "mb", "ab.contra": "bm", "r.0": "am", "r.1": "ma"}
    roads = [edge(nodes[p], nodes[q], name=name) for name, (p, q) in pairs.items()]
    net = SceneMaker.over(plain(list(nodes.values()), roads), tmp_path).network
    assert lines.cut_road(net, "ab.contra") == ("ab.contra",)
    assert lines.cut_road(net, "ab.0") == ("ab.0", "ab.1")
    assert lines.cut_road(net, "r.0") == ("r.0",), "no end is its beginning"
    assert reverse_edges(net, "ab.1") == (("ab.contra",), ("ab.1",))


def test_places_along_a_road_over_a_junction() -> None:
    net = network("corridor")
    road = road_over(net, ("bc", "cd"))
    assert road.starts == {"bc": 0.0, "cd": _about(112.8 + 14.4)}
    assert road.length == _about(112.8 + 14.4 + 112.8)
    assert road.line.length == _about(road.length)
    assert road.line.project(240.0, -4.8)[0] == _about(120.0)
    for lane, s, place in (
        ("bc_0", 10.0, 10.0),
        ("bc_1", 10.0, 10.0),
        ("cd_1", 10.0, 137.2),
        (":P2_6_1", 4.0, 116.8),
        ("cb_0", 30.0, 82.8),
        ("dc_1", 30.0, 210.0),
        ("ab_0", 110.0, -10.01),
        (":P1_2_1", 0.004, -0.006),
    ):
        assert road.place(_on(net, lane, s)) == _about(place), lane
    for lane in ("ba_0", "q_in_0", "q_out_0"):
        assert road.place(_on(net, lane, 20.0)) is None
    assert road.place(_off(150.0, -4.8)) is None


def test_a_road_that_turns_at_a_junction() -> None:
    net = network("x")
    road = road_over(net, ("w_in", "n_out"))
    before, behind = (net.lane(name).line.length for name in (":C_17_0", ":C_21_0"))
    assert road.starts["n_out"] == _about(89.6 + before + behind)
    assert road.place(_on(net, ":C_17_0", 3.0)) == _about(92.6)
    assert road.place(_on(net, ":C_21_0", 3.0)) == _about(92.6 + before)
    assert road.front(_on(net, ":C_21_0", 3.0)) == _about(92.6 + before + HALF)
    assert road.front(_on(net, "fw_in_1", 90.0)) == _about(HALF - 10.01)


def test_a_road_that_starts_behind_a_long_junction() -> None:
    net = network("corridor")
    road = road_over(net, ("cd",))
    assert road.place(_on(net, "bc_1", 100.0)) == _about(-27.2)
    assert road.place(_on(net, ":P2_6_0", 4.0)) == _about(-10.4)
    assert road.place(_on(net, "q_in_0", 20.0)) is not None
    assert road.place(_on(net, "ab_0", 20.0)) is None


def test_edges_that_nothing_joins_lie_end_to_end() -> None:
    road = road_over(network("corridor"), ("ab", "q_out"))
    assert road.starts == {"ab": 0.0, "q_out": _about(120.0)}


def test_only_who_drives_along_the_road_has_its_front_on_it() -> None:
    net = network("corridor")
    road = road_over(net, ("ab", "bc"))
    assert road.front(_on(net, "ab_1", 50.0)) == _about(50.0 + HALF)
    assert road.front(_on(net, "ab_1", 50.0, SIDEWAYS)) == _about(50.0 + HALF / 2)
    assert road.front(_on(net, "ab_1", 50.0, math.pi)) is None
    assert road.front(_on(net, "ab_1", 50.0, 2 * SIDEWAYS)) is None
    assert road.front(_on(net, "ba_0", 50.0, math.pi)) == _about(70.0 + HALF)
    assert road.front(_on(net, "ba_0", 50.0, math.pi - SIDEWAYS)) == _about(70.0 + HALF / 2)
    assert road.front(_on(net, "ba_0", 50.0)) is None
    assert road.front(_on(net, "q_out_0", 20.0)) is None
    # The first lane of the net: the other direction's way through the junction, here driven the wrong way.
    assert net.lane_index[":P1_0_0"] == 0
    assert road.front(_on(net, ":P1_0_0", 0.05, math.pi)) is None


def test_off_every_lane_a_road_is_two_carriageways_wide() -> None:
    road = road_over(network("corridor"), ("ab", "bc"))
    assert road.front(_off(50.0, -17.5)) == _about(50.0 + HALF)
    assert road.front(_off(50.0, -17.7)) is None
    assert road.front(_off(50.0, 7.9)) == _about(50.0 + HALF)
    assert road.front(_off(50.0, 8.1)) is None
    assert road.front(_off(50.0, -12.0, math.pi)) is None
    assert road.front(_off(50.0, -12.0, 1.0)) == _about(50.0 + HALF * math.cos(1.0))
    assert road.front(_off(50.0, -12.0, 2.0)) is None


def test_the_lanes_of_a_bend_are_scaled_to_one() -> None:
    net = network("curve")
    inner, middle, outer = (net.lane(f"pr_{k}").line.length for k in (2, 1, 0))
    for order, size in ((-1, outer), (0, outer), (1, middle), (2, inner), (7, inner)):
        road = road_over(net, ("pr",), order)
        assert road.length == _about(size)
        assert road.place(_on(net, "pr_2", inner / 4)) == _about(size / 4)
        assert road.place(_on(net, "pr_0", outer / 4)) == _about(size / 4)
        back = net.lane("rp_0").line.length
        assert road.place(_on(net, "rp_0", back / 4)) == _about(size * 3 / 4)


def test_the_line_at_the_end_of_an_approach() -> None:
    net = network("t")
    line = approach_line(net, "s_in")
    assert line.lanes == {net.lane_index["s_in_0"]}
    assert line.to_go(_on(net, "s_in_0", 80.0)) == _about(12.8 - HALF)
    assert line.to_go(_on(net, "s_in_0", 92.0)) == _about(0.8 - HALF)
    assert line.to_go(_on(net, "s_in_0", 80.0, SIDEWAYS)) == _about(12.8 - HALF / 2)
    assert line.to_go(_on(net, "s_in_0", 80.0, math.pi)) is None
    assert line.to_go(_on(net, "s_out_0", 20.0, math.pi)) == _about(20.0 - HALF)
    assert line.to_go(_on(net, "s_out_0", 20.0, math.pi - SIDEWAYS)) == _about(20.0 - HALF / 2)
    assert line.to_go(_on(net, "s_out_0", 20.0)) is None
    assert line.to_go(_on(net, "s_out_0", 20.0, SIDEWAYS)) is None
    assert line.to_go(_on(net, "w_in_0", 20.0)) is None
    assert line.to_go(_off(7.9, -50.0, math.pi / 2)) == _about(50.0 - 7.2 - HALF)
    assert line.to_go(_off(8.1, -50.0, math.pi / 2)) is None
    assert line.to_go(_off(-4.7, -50.0, math.pi / 2)) == _about(50.0 - 7.2 - HALF)
    assert line.to_go(_off(5.0, -50.0, -math.pi / 2)) is None
    assert line.to_go(_off(5.0, -50.0, -0.2)) is None


def test_who_is_in_the_junction_has_no_line_to_go_to() -> None:
    net = network("forks")
    line = approach_line(net, "l33_in")
    assert line.to_go(_on(net, "l33_in_0", 80.0)) == _about(net.lane("l33_in_0").line.length - 80.0 - HALF)
    for way in (":J1_0_0", ":J1_1_0", ":J1_2_0"):
        assert line.to_go(_on(net, way, 0.5)) is None
    assert net.lane_index[":J1_0_0"] == 0
