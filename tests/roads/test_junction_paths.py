"""Paths through small junctions and where they conflict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.roads.junction_paths import JunctionPath, junction_paths, path_zones
from tsbench.roads.network import RoadNetwork, read_network


def _network(name: str) -> RoadNetwork:
    return read_network(Path(__file__).parent.parent / "cases" / "nets" / f"{name}.net.xml")


def _between(net: RoadNetwork, source: str, target: str) -> JunctionPath:
    return next(p for p in junction_paths(net, (source,)) if p.target.edge == target)


def test_paths_come_by_edge_then_by_lane_and_lead_from_the_line_to_the_exit() -> None:
    net = _network("x")
    paths = junction_paths(net, ("s_in", "w_in"))
    sources = [p.source.id for p in paths]
    assert sources == sorted(sources)
    for path in paths:
        inner = [net.lanes[v] for v in path.connection.via]
        assert path.line.length == pytest.approx(sum(lane.line.length for lane in inner), abs=1e-6)
        assert path.line.points[0] == pytest.approx(path.source.line.points[-1], abs=0.05)
        assert path.line.points[-1] == pytest.approx(path.target.line.points[0], abs=0.05)
        assert path.width == max(lane.width for lane in inner)


def test_a_path_goes_on_along_its_exit_as_far_as_that_reaches() -> None:
    path = _between(_network("x"), "w_in", "e_out")
    assert path.onto_exit(15.0).length == pytest.approx(path.line.length + 15.0, abs=0.05)
    whole = path.line.length + path.target.line.length
    assert path.onto_exit(1e6).length == pytest.approx(whole, abs=0.05)


def test_crossing_paths_have_a_zone_and_those_that_part_none() -> None:
    net = _network("x")
    across = _between(net, "s_in", "n_out")
    met = [_between(net, "w_in", "e_out"), _between(net, "w_in", "s_out")]
    zone, none = path_zones((across,), met, least_overlap=0.5)[0]
    assert zone is not None
    assert none is None
    assert zone.a_out - zone.a_in == pytest.approx(met[0].width, abs=0.2)
    narrow = path_zones((across,), met, width=1.0)[0][0]
    assert narrow.a_out - narrow.a_in == pytest.approx(1.0, abs=0.2)


def test_what_overlaps_by_less_than_asked_is_no_zone() -> None:
    net = _network("x")
    a, b = _between(net, "s_in", "n_out"), _between(net, "w_in", "e_out")
    for least, met in ((3.0, True), (3.5, False)):
        zone = path_zones((a,), (b,), least_overlap=least)[0][0]
        assert (zone is not None) == met, least


def test_a_connection_without_internal_lanes_is_named() -> None:
    net = _network("t")
    bare = tuple(tuple(replace(c, via=()) for c in connections) for connections in net.outgoing)
    with pytest.raises(InputError) as refusal:
        junction_paths(replace(net, outgoing=bare), ("s_in",))
    assert str(refusal.value) == "edge 's_in': a connection without internal lanes (rebuild the network)"
