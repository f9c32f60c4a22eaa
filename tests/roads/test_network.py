"""Our reader of networks against sumolib, SUMO's own: small cases, and a crop of each type in both halves."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sumolib

from tsbench.roads.network import Connection, RoadNetwork, read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.store import SceneStore
from tsbench.sim.scene import SceneFile

CASES = Path(__file__).parent.parent / "cases" / "nets"
SMALL = sorted(CASES.glob("*.net.xml"))
# A lane of no extent is given one by our reader.
EXACT_M, TOUCH_M = 1e-9, 0.011


@cache
def crops() -> dict[str, tuple[Path, bytes]]:
    """Of each type the networks of its first dev pair: uncompressed, by name."""
    store = SceneStore(DataSet())
    found: dict[str, SceneFile] = {}
    for row in DataSet().table("dev"):
        if row.variant == 0:
            found.setdefault(f"{row.pair_type} {row.half}", store.read(row, row.net))
    return {name: (file.path, file.content) for name, file in sorted(found.items())}


def both(path: Path, content: bytes, folder: Path) -> tuple[RoadNetwork, sumolib.net.Net]:
    """A network as our reader and as sumolib takes it, which reads files only."""
    plain = folder / "plain.net.xml"
    plain.write_bytes(content)
    return read_network(path, content), sumolib.net.readNet(str(plain), withInternal=True)


def assert_equal(ours: RoadNetwork, theirs: sumolib.net.Net) -> None:
    driven = [e for e in theirs.getEdges() if e.getFunction() in ("", "internal", None)]
    assert set(ours.edges) == {e.getID() for e in driven}
    assert {lane.id for lane in ours.lanes} == {lane.getID() for e in driven for lane in e.getLanes()}
    for edge in driven:
        own = ours.edges[edge.getID()]
        assert own.internal == (edge.getFunction() == "internal")
        if not own.internal:
            assert (own.source, own.target) == (edge.getFromNode().getID(), edge.getToNode().getID())
            assert (own.priority, own.road_class) == (edge.getPriority(), edge.getType())
        for lane, other in zip(ours.edge_lanes(edge.getID()), edge.getLanes(), strict=True):
            assert (lane.id, lane.edge, lane.order) == (other.getID(), edge.getID(), other.getIndex())
            assert (lane.speed, lane.length, lane.width) == (other.getSpeed(), other.getLength(), other.getWidth())
            points = np.array(other.getShape())
            apart = TOUCH_M if np.ptp(points, axis=0).max() < 1e-6 else EXACT_M
            assert np.abs(lane.line.points - points).max() <= apart
            for kind in ("passenger", "bus", "bicycle", "pedestrian"):
                assert lane.permits(kind) == other.allows(kind)
    assert_same_ways(ours, theirs)
    assert {e.getID() for e in theirs.getEdges() if e.getFunction() == "crossing"} == set(ours.crossings)
    nodes = {n.getID(): n for n in theirs.getNodes() if n.getType() != "internal"}
    assert set(ours.junctions) == set(nodes)
    for name, junction in ours.junctions.items():
        assert (junction.x, junction.y, junction.type) == (*nodes[name].getCoord(), nodes[name].getType())


def assert_same_ways(ours: RoadNetwork, theirs: sumolib.net.Net) -> None:
    """Equal connections, with the lanes that lead through the junction, and equal rights of way."""
    expected = {}
    for edge in theirs.getEdges():
        if edge.getFunction():
            continue
        for found in (link for links in edge.getOutgoing().values() for link in links):
            if found.getTo().getFunction():
                continue
            ends = found.getFromLane().getID(), found.getToLane().getID()
            expected[ends] = (found.getDirection(), found.getState(), chain(theirs, found), found)

    def ends_of(link: Connection) -> tuple[str, str]:
        return ours.lanes[link.from_lane].id, ours.lanes[link.to_lane].id

    assert {ends_of(c): (c.direction, c.state, [ours.lanes[v].id for v in c.via]) for c in ours.connections} == {
        ends: tuple(found[:3]) for ends, found in expected.items()
    }
    for one in ours.connections:
        for other in ours.connections:
            a, b = expected[ends_of(one)][3], expected[ends_of(other)][3]
            if one is not other and a.getJunction() is b.getJunction():
                assert bool(one.yields_to & set(other.via)) == a.getJunction().forbids(b, a)


def chain(net: sumolib.net.Net, link: sumolib.net.Connection) -> list[str]:
    """Lanes inside the junction, in order."""
    lanes, step = [], link.getViaLaneID()
    while step:
        lanes.append(step)
        (after,) = net.getLane(step).getOutgoing()
        step = after.getViaLaneID()
    return lanes


@pytest.mark.parametrize("path", SMALL, ids=lambda path: path.name)
def test_a_small_network_is_read_as_sumolib_reads_it(path: Path, tmp_path: Path) -> None:
    assert_equal(*both(path, path.read_bytes(), tmp_path))


@pytest.mark.parametrize("name", crops())
def test_a_crop_is_read_as_sumolib_reads_it(name: str, tmp_path: Path) -> None:
    assert_equal(*both(*crops()[name], tmp_path))
