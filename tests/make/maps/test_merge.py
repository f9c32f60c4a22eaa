"""Legs of a ring as one edge each."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from tsbench.make.maps.crop import BETWEEN_M, merge_chains, part_carriageways
from tsbench.make.maps.pieces import length
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode

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
