"""The lint refuses what it must, in a batch as alone."""

from __future__ import annotations

import pytest

from tsbench.make.maps.crop import Expectations, lint_crops
from tsbench.make.maps.plain import PlainEdge, PlainNet, PlainNode

Points = tuple[tuple[float, float], ...]
NOTHING = Expectations({})


def edge(name: str, shape: Points, *, lanes: int = 1, width: float = 3.5) -> PlainEdge:
    tail, head = name.split("-")
    return PlainEdge(name, tail, head, lanes, 13.89, 5, shape, "highway.tertiary", width=width, spread="center")


def net(*edges: PlainEdge) -> PlainNet:
    places = {e.source: e.shape[0] for e in edges} | {e.target: e.shape[-1] for e in edges}
    return PlainNet(tuple(PlainNode(name, *place) for name, place in sorted(places.items())), edges, ())


GOOD = net(edge("a-b", ((0, 0), (100, 0))), edge("b-c", ((100, 0), (200, 0))))
CROSSING = net(edge("a-b", ((0, 0), (100, 0))), edge("c-d", ((50, -50), (50, 50))))
PARALLEL = net(edge("a-b", ((0, 0), (100, 0))), edge("c-d", ((0, 2), (100, 2))))
NEIGHBOURS = net(edge("a-b", ((0, 0), (100, 0))), edge("c-d", ((0, 3.6), (100, 3.6))))
NARROW = net(edge("a-b", ((0, 0), (100, 0)), width=1.5))
BENT = net(edge("a-b", ((0, 0), (100, 0))), edge("b-c", ((100, 0), (100, 100))))
UNKNOWN_NODE = PlainNet(GOOD.nodes[1:], GOOD.edges, ())

CASES = [
    (GOOD, NOTHING, ""),
    (GOOD, Expectations({"a-b": 8.0}, [("a-b", "b-c")], {("a-b", "b-c"): "s"}), ""),
    (NEIGHBOURS, NOTHING, ""),
    (CROSSING, NOTHING, "lanes overlap outside junctions"),
    (PARALLEL, NOTHING, "lanes overlap outside junctions"),
    (NARROW, NOTHING, "implausible lane width"),
    (GOOD, Expectations({"a-b": 120.0}), "too little room before the junction"),
    (net(edge("a-b", ((0, 0), (5, 0)))), Expectations({"a-b": 8.0}), "a used lane is shorter than 8 m"),
    (GOOD, Expectations({}, [("b-c", "a-b")]), "an arm or way cannot be reached"),
    (BENT, Expectations({}, [], {("a-b", "b-c"): "l"}), ""),
    (BENT, Expectations({}, [], {("a-b", "b-c"): "r"}), "SUMO's direction differs from the heading change"),
    (UNKNOWN_NODE, NOTHING, "netconvert refuses it"),
]


@pytest.mark.parametrize(("plain", "wanted", "fault"), CASES)
def test_one_crop(workplace: object, plain: PlainNet, wanted: Expectations, fault: str) -> None:
    assert lint_crops([(plain, wanted)]) == [fault]


def test_a_batch_gives_what_each_crop_gives_alone(workplace: object) -> None:
    assert lint_crops([(plain, wanted) for plain, wanted, _ in CASES]) == [fault for *_, fault in CASES]


def test_no_crops() -> None:
    assert lint_crops([]) == []
