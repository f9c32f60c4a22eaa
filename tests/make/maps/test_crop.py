"""Crops: where they lie, what is built of them, and legs of a ring as one edge each."""

from __future__ import annotations

import gzip
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.make.maps.crop import (
    BETWEEN_M,
    REGISTRY,
    lint_crops,
    loads_in_sumo,
    merge_chains,
    part_carriageways,
    plain_crop,
)
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.pieces import length
from tsbench.make.maps.plain import PlainConnection, PlainCrossing, PlainEdge, PlainLane, PlainNet, PlainNode
from tsbench.make.maps.source import SourceNetwork
from tsbench.roads.network import read_network
from tsbench.scenarios.map_pool import PoolRow


def rows_of(source: SourceNetwork, family: str) -> list[PoolRow]:
    return list(REGISTRY[family].find(source, Counter()))


def a_t(source: SourceNetwork) -> PoolRow:
    return next(row for row in rows_of(source, "junction") if row.shape == "T")


@pytest.mark.parametrize("family", list(REGISTRY))
def test_crops_are_sound_and_lie_where_the_row_says(tiny: SourceNetwork, family: str) -> None:
    rows = rows_of(tiny, family)[:12]
    crops = [plain_crop(row, tiny) for row in rows]
    expect = REGISTRY[family].expect
    assert lint_crops([(crop, expect(row)) for crop, row in zip(crops, rows, strict=True)]) == [""] * len(rows)
    for row, crop in zip(rows, crops, strict=True):
        points = np.array([point for edge in crop.edges for point in edge.shape])
        centre = np.array([float(crop.attributes["utm_east"]), float(crop.attributes["utm_north"])])
        assert np.abs((points.max(axis=0) + points.min(axis=0)) / 2 + centre - (row.east, row.north)).max() < 0.2
        assert np.ptp(points, axis=0) / 2 == pytest.approx([row.half_w, row.half_h], abs=0.1)
        assert crop.origin == pytest.approx((row.lat, row.lon), abs=1e-4)
        known = set(tiny.edge_ids)
        assert all(edge.id in known for edge in crop.edges)


def test_arms_are_cut_at_80_m_and_dead_ends_are_shared(tiny: SourceNetwork) -> None:
    crop = plain_crop(a_t(tiny), tiny)
    assert all(length(np.array(edge.shape)) <= 80.01 for edge in crop.edges)
    assert len(crop.nodes) == 4
    assert all(node.type == "priority" for node in crop.nodes)


def test_a_corridor_keeps_the_other_direction_and_no_junction(tiny: SourceNetwork) -> None:
    row = next(row for row in rows_of(tiny, "corridor") if not row.oneway and row.lanes == 2)
    crop = plain_crop(row, tiny)
    assert {edge.id for edge in crop.edges} == {row.fields["edge"], row.fields["opposite"]}
    assert len(crop.nodes) == 2


def test_a_built_net_is_the_same_bytes_and_holds_no_date(tiny: SourceNetwork, tmp_path: Path) -> None:
    crop = plain_crop(a_t(tiny), tiny)
    for name in ("a.net.xml.gz", "b.net.xml.gz", "c.net.xml"):
        build_net(crop, tmp_path / name)
    data = (tmp_path / "a.net.xml.gz").read_bytes()
    assert data == (tmp_path / "b.net.xml.gz").read_bytes()
    assert gzip.decompress(data) == (tmp_path / "c.net.xml").read_bytes()
    assert b"generated on" not in gzip.decompress(data)
    assert loads_in_sumo(tmp_path / "a.net.xml.gz")


def test_edits_of_a_scene_reach_the_network(tmp_path: Path, workplace: Path) -> None:
    nodes = (PlainNode("a", 0, 0), PlainNode("m", 100, 0), PlainNode("b", 200, 0))
    place = {"a": (0.0, 0.0), "m": (100.0, 0.0), "b": (200.0, 0.0)}
    walk = PlainLane(0, width=2.0, allow="pedestrian")
    edges = tuple(
        PlainEdge(s + t, s, t, 3, 16.67, 5, (place[s], place[t]), "highway.secondary", width=3.5, lanes=(walk,))
        for s, t in ("am", "mb", "bm", "ma")
    )
    links = (PlainConnection("am", "mb", 1, 2),)
    build_net(PlainNet(nodes, edges, links, (PlainCrossing("m", ("am", "ma")),)), tmp_path / "edited.net.xml")
    text = (tmp_path / "edited.net.xml").read_text()
    assert 'function="crossing"' in text
    assert '<connection from="am" to="mb" fromLane="1" toLane="2"' in text
    assert '<connection from="am" to="mb" fromLane="2"' not in text


def test_a_refused_net_is_one_line(tmp_path: Path, tiny: SourceNetwork) -> None:
    crop = plain_crop(a_t(tiny), tiny)
    broken = replace(crop, nodes=crop.nodes[1:])
    with one_line("broken.net.xml"):
        build_net(broken, tmp_path / "broken.net.xml")
    assert not (tmp_path / "broken.net.xml").exists()


def test_a_row_needs_its_own_source(tiny: SourceNetwork) -> None:
    row = a_t(tiny)
    with pytest.raises(InputError, match="cut from 'elsewhere'"):
        plain_crop(replace(row, source="elsewhere"), tiny)
    with pytest.raises(InputError, match="no edge 'gone'"):
        plain_crop(replace(row, family="corridor", detail='{"edge":"gone","span":[0,150]}'), tiny)


def test_a_crop_is_cut_and_built_quickly(tiny: SourceNetwork, tmp_path: Path) -> None:
    row = a_t(tiny)
    times = []
    for _ in range(5):
        before = os.times()
        build_net(plain_crop(row, tiny), tmp_path / "quick.net.xml.gz")
        times.append(sum(os.times()[:4]) - sum(before[:4]))
    # seconds of processor, ours and netconvert's, so that a busy machine does not matter: 0.10 is usual
    assert min(times) < 0.25


def test_facts_of_a_broken_net_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "half.net.xml").write_text("<net><edge id=")
    with pytest.raises(InputError, match=r"half\.net\.xml"):
        read_network(tmp_path / "half.net.xml")


WIDTH = 3.5


def edge(
    name: str, source: str, target: str, *shape: tuple[float, float], lanes: int = 1, spread: str = "center"
) -> PlainEdge:
    return PlainEdge(name, source, target, lanes, 14.0, 5, shape, width=WIDTH, spread=spread)


def split_road(opening: float, lanes: int = 1) -> PlainNet:
    """A two-way road from the west that splits at s into a branch to a and one from b, `opening` m apart."""
    half = opening / 2
    nodes = (PlainNode("w", -60, 0), PlainNode("s", 0, 0), PlainNode("a", 30, -half), PlainNode("b", 30, half))
    return PlainNet(
        nodes,
        (
            edge("road_in", "w", "s", (-60, 0), (0, 0), lanes=lanes, spread="right"),
            edge("branch_in", "s", "a", (0, 0), (30, -half)),
            edge("branch_out", "b", "s", (30, half), (0, 0)),
            edge("road_out", "s", "w", (0, 0), (-60, 0), spread="right"),
        ),
        (),
    )


CHAINS = [(["road_in", "branch_in"], "branch_in"), (["branch_out", "road_out"], "branch_out")]


@pytest.mark.parametrize("opening", [12.0, 25.0, 55.0])
@pytest.mark.parametrize("lanes", [1, 2])
def test_a_branch_and_its_road_become_one_edge(opening: float, lanes: int) -> None:
    net = merge_chains(split_road(opening, lanes), CHAINS)
    assert {e.id for e in net.edges} == {"branch_in", "branch_out"}
    assert {n.id for n in net.nodes} == {"w", "a", "b"}
    entry, leave = (next(e for e in net.edges if e.id == name) for name in ("branch_in", "branch_out"))
    assert (entry.source, entry.target, entry.num_lanes) == ("w", "a", 1)
    assert (leave.source, leave.target) == ("b", "w")
    assert entry.shape[0] == pytest.approx((-60, -WIDTH / 2))
    assert entry.shape[-1] == pytest.approx((30, -opening / 2))
    # Right of the other all the way, with room for both, and without a step back.
    one, other = np.array(entry.shape), np.array(leave.shape)
    apart = shapely.distance(shapely.points(one), shapely.linestrings(other))
    assert apart.min() >= WIDTH - 0.5  # what the lint lets pass
    steps = np.diff(one, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.abs(np.diff(heading)).max() < np.radians(75)
    assert length(one) == pytest.approx(60 + np.hypot(30, opening / 2), rel=0.05)


def test_a_chain_that_shares_an_edge_stays() -> None:
    net = split_road(20.0)
    chains = [(["road_in", "branch_in"], "branch_in"), (["road_in", "branch_in"], "branch_in")]
    assert {e.id for e in merge_chains(net, chains).edges} == {e.id for e in net.edges}


def test_carriageways_drawn_too_near_get_room() -> None:
    nodes = tuple(PlainNode(name, x, y) for name, x, y in (("a", 0, 0), ("b", 80, 0), ("c", 80, 4), ("d", 0, 4)))
    east = edge("east", "a", "b", (0, 0), (80, 0), lanes=2)
    west = edge("west", "c", "d", (80, 4), (0, 4), lanes=2)
    net = part_carriageways(PlainNet(nodes, (east, west), ()), [("east", "west")])
    one, other = (np.array(e.shape) for e in net.edges)
    assert other[:, 1].min() - one[:, 1].max() == pytest.approx(2 * WIDTH + BETWEEN_M, abs=0.02)
    far = edge("west", "c", "d", (80, 20), (0, 20), lanes=2)
    net = PlainNet(nodes, (east, far), ())
    assert part_carriageways(net, [("east", "west")]).edges == net.edges
