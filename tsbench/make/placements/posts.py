"""Posts beside the ways of a scene that bind no watched vehicle: where they can stand. Units: m."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tsbench.core.benchmark import SIGN_RANGE_M
from tsbench.geometry.polyline import Polyline
from tsbench.make.placements.placement import Arrangement, SceneTask, passenger_lanes, plate_beside
from tsbench.make.scenes.driven_plates import broken_plates
from tsbench.make.scenes.placed_plates import CLOSING, PlacedPlates
from tsbench.make.scenes.plate_places import refused
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.places import load_places
from tsbench.sim.scene import EgoStart

# Room before an arm's line and behind its start, from a line to a plate at it, and from post to post.
_CLEAR_M = 15.0
_AT_LINE_M = 2.0
_APART_M = 8.0
_OFF_M = 0.5
# Places that are tried on each edge.
TRIES = 16


def place_along(code: str, length: float, task: SceneTask) -> float:
    """Where along an edge a plate stands: as far from the line or the junction as the sign may, else anywhere."""
    placement = task.recipe.catalog.sign(code).placement
    if placement.reference == "line":
        return length - float(task.rng.uniform(_AT_LINE_M, min(placement.distance_m[1], _CLEAR_M)))
    if placement.reference == "exit_start":
        return float(task.rng.uniform(*placement.distance_m))
    table = load_places()
    if "entered" in table.signs.get(code, ()):
        return float(task.rng.uniform(_AT_LINE_M, table.distances.mouth_m))
    return float(task.rng.uniform(_CLEAR_M, length - _CLEAR_M))


def can_stand(plates: Sequence[tuple[SignInstance, ...]], halves: Sequence[PlacedPlates]) -> bool:
    """Can all of each half's plates stand in it, and does no vehicle break one?"""
    for more, half in zip(plates, halves, strict=True):
        scene = replace(half, plates=(*half.plates, *more))
        # A closed road bears on the plates of the roads that lead to it.
        closing = any(plate.code in CLOSING for plate in more)
        if any(refused(scene, plate) for plate in (scene.plates if closing else more)):
            return False
        if any(p in more for v in scene.vehicles for p, _ in broken_plates(scene, v)):
            return False
    return True


def shuffled(words: Sequence[str], task: SceneTask) -> list[str]:
    return [words[int(k)] for k in task.rng.permutation(len(words))]


def in_sight(task: SceneTask, start: EgoStart, post: SignInstance) -> bool:
    """Is a post near enough to the ego's start, and at a junction to its line too?"""
    way = task.network.lane(start.lane).line
    places = (start.s, *((way.length,) if task.row.family == "junction" else ()))
    return all(math.dist(way.point_at(s), (post.x, post.y)) < SIGN_RANGE_M for s in places)


def on_its_place(post: SignInstance, line: Polyline) -> bool:
    """In a bend a post may stand beside another place of its road than it is meant for."""
    return abs(line.project(post.x, post.y)[0] - post.position_m) < _OFF_M


def is_apart(post: SignInstance, others: Sequence[SignInstance]) -> bool:
    return all(math.dist((post.x, post.y), (other.x, other.y)) >= _APART_M for other in others)


def facing_ego(
    task: SceneTask, arrangement: Arrangement, edges: Sequence[str]
) -> tuple[SignInstance, SignInstance] | None:
    """Two posts on one of the edges, in its direction, for a begin and its end; None where there is no room.

    Both are in sight all the way from the ego's start to its line, and apart from all others.
    """
    least = load_places().distances.zone_m
    way = task.network.lane(arrangement.start.lane).line
    seen_from = [way.point_at(s) for s in (arrangement.start.s, way.length)]
    for edge in shuffled(edges, task):
        line = task.network.edge_lanes(edge)[0].line
        places = np.arange(_CLEAR_M, line.length - _CLEAR_M, _APART_M).tolist()
        posts = [bare_post(task, arrangement, edge, s, 0) for s in places]
        near = [
            p
            for p in posts
            if on_its_place(p, line) and all(math.dist(at, (p.x, p.y)) < SIGN_RANGE_M for at in seen_from)
        ]
        free = [p for p in near if is_apart(p, arrangement.signs)]
        pairs = [(a, b) for a in free for b in free if b.position_m - a.position_m >= least]
        if pairs:
            chosen = pairs[int(task.rng.integers(len(pairs)))]
            first, second = (bare_post(task, arrangement, p.edge, p.position_m, k) for k, p in enumerate(chosen))
            return first, second
    return None


def bare_post(task: SceneTask, arrangement: Arrangement, edge: str, s: float, k: int) -> SignInstance:
    """The k-th post beyond those of an arrangement, its plate not yet chosen."""
    number, code = len(arrangement.signs) + k, arrangement.signs[0].code
    return plate_beside(task.network, code, edge, s, number=number, role=DISTRACTOR)


def leading_to(task: SceneTask, arrangement: Arrangement) -> list[str]:
    """Edges with cars, on none of the ego's ways, that lead to it from the side or run against it."""
    edges, graph = task.network.edges, task.graph
    near = {n for e in arrangement.route_hint for n in (edges[e].source, edges[e].target)}
    ends = {(edges[e].source, edges[e].target) for e in _ways(arrangement)}

    def leads(name: str) -> bool:
        against = edges[name].source in near and (edges[name].target, edges[name].source) in ends
        return against or (edges[name].target in near and bool(graph.successors(name)))

    # A corridor has no roads but its own two directions, a ring none but its arms.
    if task.row.family in ("corridor", "roundabout"):
        ring = task.row.fields.get("ring", ())
        return [name for name in beside_ways(task, arrangement) if name not in ring]
    return [name for name in beside_ways(task, arrangement) if leads(name)]


def _ways(arrangement: Arrangement) -> set[str]:
    return {*arrangement.route_hint, *arrangement.compliant_hint}


def beside_ways(task: SceneTask, arrangement: Arrangement) -> Iterator[str]:
    """Edges with cars that have room for a post, in a fixed order, but those of the ego's ways."""
    network, ways = task.network, _ways(arrangement)
    for name in sorted(network.edges.keys() - ways):
        long_enough = network.edge_lanes(name)[0].line.length > 2.0 * _CLEAR_M
        if long_enough and not network.edges[name].internal and passenger_lanes(network, name):
            yield name
