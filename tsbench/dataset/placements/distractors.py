"""Plates that bind others, or nobody, on the way: what stands there is no answer. Source: docs/spec/contrast.md."""

from __future__ import annotations

from collections.abc import Iterator

from tsbench.dataset.placements.base import Arrangement, SceneTask, passenger_lanes, plate_beside
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.catalog import load_catalog

# Room before an arm's line and behind its start, and from post to post.
_CLEAR_M = 15.0
_APART_M = 8.0
_OFF_M = 0.5


def distractors(task: SceneTask, arrangement: Arrangement) -> tuple[SignInstance, ...]:
    """As many as the variant asks for and the map has room for, of codes that are not the scene's.

    They face who comes towards the ego, or on roads that lead to its way from the side; the ego drives none of these.
    """
    catalog = load_catalog()
    taken = {s.code for s in arrangement.signs}
    codes = [c for kind in catalog.types for c in kind.codes if c not in taken and kind.group != "priority"]
    places = list(_places(task, arrangement))
    rng, found = task.rng, list(arrangement.signs)
    for k in task.rng.permutation(len(places)):
        if len(found) - len(arrangement.signs) >= task.variant.distractors:
            break
        edge, s = places[int(k)]
        code = codes[int(rng.integers(len(codes)))]
        value = catalog.sign(code).value
        shown = None if value is None else float(value.allowed[int(rng.integers(len(value.allowed)))])
        plate = plate_beside(
            task.network, code, edge, s, number=100 + len(found), role=DISTRACTOR, value=shown
        )
        # In a bend the post may stand beside another place of its road than it is meant for.
        line = task.network.edge_lanes(edge)[0].line
        if abs(line.project(plate.x, plate.y)[0] - s) < _OFF_M and all(
            (plate.x - p.x) ** 2 + (plate.y - p.y) ** 2 > _APART_M**2 for p in found
        ):
            found.append(plate)
    return tuple(found[len(arrangement.signs) :])


def _places(task: SceneTask, arrangement: Arrangement) -> Iterator[tuple[str, float]]:
    """(edge, m along it) where a plate faces somebody else: edges with cars that are on none of the ego's ways."""
    network, graph = task.network, task.graph
    ways = {*arrangement.route_hint, *arrangement.compliant_hint}
    near = {n for e in arrangement.route_hint[:2] for n in (network.edges[e].source, network.edges[e].target)}
    for name in sorted(network.edges):
        edge = network.edges[name]
        if edge.internal or name in ways or not passenger_lanes(network, name):
            continue
        length = network.edge_lanes(name)[0].line.length
        towards = edge.target in near and graph.successors(name)
        back = edge.source in near and (edge.target, edge.source) in _ends(task, ways)
        if (towards or back) and length > 2.0 * _CLEAR_M:
            yield name, float(task.rng.uniform(_CLEAR_M, length - _CLEAR_M))


def _ends(task: SceneTask, ways: set[str]) -> set[tuple[str, str]]:
    return {(task.network.edges[e].source, task.network.edges[e].target) for e in ways}
