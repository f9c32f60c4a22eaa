"""Posts beside the ways of a scene that bind no watched vehicle: where they can stand, and what hangs on them.

Distractors are plates on the way that do not bind the ego: what stands there is no answer. Counterparts make the plates
of both halves of a pair the same: a plate of the one half alone hangs in the other where it binds others.
Source: docs/contrast.md. Units: m.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tsbench.core.benchmark import SIGN_RANGE_M
from tsbench.geometry.polyline import Polyline
from tsbench.make.placements.placement import (
    Arrangement,
    SceneTask,
    UnfitMapError,
    UnluckyDrawError,
    passenger_lanes,
    plate_beside,
)
from tsbench.make.scenes.plate_checks import refused
from tsbench.make.scenes.plate_roads import PlateRoads, Sent, shut_roads
from tsbench.make.scenes.plate_surroundings import CLOSING, PlacedPlates, broken_plates
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.sim.scene import EgoStart

# Room before an arm's line and behind its start, from a line to a plate at it, and from post to post.
_CLEAR_M = 15.0
_AT_LINE_M = 2.0
_APART_M = 8.0
_OFF_M = 0.5
# Places that are tried on each edge.
TRIES = 16
# Rules of plates that are no distractors: traffic is slower than 4.6 asks, and no lane is painted for 5.14.x.
_NEVER = ("min_speed", "reserved_lane")
_Plate = tuple[str, float | None]
_Swap = tuple[_Plate, _Plate]
_Held = tuple[SignInstance, _Plate, _Plate]


def place_along(code: str, length: float, task: SceneTask) -> float:
    """Where along an edge a plate stands: as far from the line or the junction as the sign may, else anywhere."""
    placement = task.recipe.catalog.sign(code).placement
    if placement.reference == "line":
        return length - float(task.rng.uniform(_AT_LINE_M, min(placement.distance_m[1], _CLEAR_M)))
    if placement.reference == "exit_start":
        return float(task.rng.uniform(*placement.distance_m))
    if "entered" in task.recipe.catalog.sign(code).places:
        return float(task.rng.uniform(_AT_LINE_M, task.recipe.catalog.distances.mouth_m))
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
    least = task.recipe.catalog.distances.zone_m
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


def distractors(task: SceneTask, arrangement: Arrangement, halves: Sequence[PlacedPlates]) -> tuple[SignInstance, ...]:
    """As many as the variant asks for and the map has places for, of codes that are not the scene's.

    They face oncoming traffic, or stand on side roads that lead to the ego's way.

    halves: of the scene; in each a plate can stand where it stands, and no vehicle breaks it.
    """
    catalog, wanted, taken = (task.recipe.catalog, task.variant.distractors, {s.code for s in arrangement.signs})
    kinds = [
        kind
        for kind in catalog.types
        if kind.group != "priority"
        and taken.isdisjoint(kind.codes)
        and catalog.sign(kind.codes[0]).rule.name not in _NEVER
    ]
    edges = leading_to(task, arrangement)
    codes = [code for kind in kinds for code in kind.codes]
    found: list[SignInstance] = []
    while len(found) < wanted:
        plate = _fitting(task, arrangement, edges, codes, tuple(found), halves)
        if plate is None:
            break
        found.append(plate)
    return tuple(found)


def _fitting(
    task: SceneTask,
    arrangement: Arrangement,
    edges: Sequence[str],
    codes: Sequence[str],
    found: tuple[SignInstance, ...],
    halves: Sequence[PlacedPlates],
) -> SignInstance | None:
    """A plate of the first of the codes, in a drawn order, that can stand on one of the edges, or None."""
    for code in shuffled(codes, task):
        for edge in shuffled(edges, task):
            line = task.network.edge_lanes(edge)[0].line
            post = bare_post(task, arrangement, edge, place_along(code, line.length, task), len(found))
            if on_its_place(post, line) and is_apart(post, (*arrangement.signs, *found)):
                for plate in _bearings(post, code, task):
                    # No office closes a road that lanes lead into, though no vehicle of the scene may enter it.
                    if plate.code not in CLOSING and can_stand([(*found, plate)] * len(halves), halves):
                        return plate
    return None


def _bearings(post: SignInstance, code: str, task: SceneTask) -> list[SignInstance]:
    """The post with a plate, once for each value that the sign may post, in a drawn order."""
    value = task.recipe.catalog.sign(code).value
    if value is None:
        return [replace(post, code=code, value=None)]
    order = task.rng.permutation(len(value.allowed)).tolist()
    return [replace(post, code=code, value=float(value.allowed[k])) for k in order]


def with_same_plates(
    task: SceneTask, signed: Arrangement, contrast: Arrangement, halves: Sequence[PlacedPlates]
) -> tuple[Arrangement, Arrangement]:
    """Both halves with posts more, so that they have the same plates: only where each stands differs.

    What would hang in one half alone hangs in the other on a post that binds nobody who is watched, in sight from the
    ego's start, at a junction from its line too: where both halves' plates can stand, on any road that is not on the
    ego's ways; other traffic is sent as they say. For limits that end see `_with_same_limits`. Raises
    UnluckyDrawError where no place holds a plate.

    halves: the signed and the contrast scene without background traffic.
    """
    ours, theirs = (Counter((s.code, s.value) for s in half.signs) for half in (signed, contrast))
    swaps = list(zip(_in_order(theirs - ours), _in_order(ours - theirs), strict=True))
    if any(task.recipe.catalog.sign(code).is_end for (code, _), _ in swaps):
        return _with_same_limits(task, signed, contrast)
    held = _held_posts(task, signed, swaps, halves)
    sent = _sent(task, signed, held, halves[0].roads)
    if len(held) < len(swaps) or sent is None:
        codes = " and ".join(sorted({code for swap in swaps for code, _ in swap}))
        raise UnluckyDrawError(f"no place for plates {codes} that binds nobody")
    signed, contrast = (
        replace(half, avoid_turns=sent.avoid_turns, closed_edges=sent.closed_edges) for half in (signed, contrast)
    )
    return _on_posts(signed, contrast, sorted(held, key=lambda h: (h[0].edge, h[0].position_m)))


def _held_posts(
    task: SceneTask, arrangement: Arrangement, swaps: Sequence[_Swap], halves: Sequence[PlacedPlates]
) -> list[_Held]:
    """A post for each swap at which the one plate can stand in the one half and the other in the other, if any."""
    found: list[_Held] = []
    for swap in swaps:
        post = next(_posts_holding(task, arrangement, swap, found, halves), None)
        if post is not None:
            found.append((post, *swap))
    return found


def _posts_holding(
    task: SceneTask, arrangement: Arrangement, swap: _Swap, found: list[_Held], halves: Sequence[PlacedPlates]
) -> Iterator[SignInstance]:
    """Posts for a swap, those first for which the fewest roads are closed to other traffic."""
    others, closing = [post for post, _, _ in found], {}
    for edge in shuffled(sorted(beside_ways(task, arrangement)), task):
        middle = bare_post(task, arrangement, edge, halves[0].roads.length(edge) / 2, len(found))
        sent = _sent(task, arrangement, [*found, (middle, *swap)], halves[0].roads)
        if sent is not None:
            closing[edge] = len(sent.closed_edges)
    for edge in sorted(closing, key=closing.__getitem__):
        line = task.network.edge_lanes(edge)[0].line
        for _ in range(TRIES):
            s = place_along(swap[int(task.rng.integers(2))][0], line.length, task)
            post = bare_post(task, arrangement, edge, s, len(found))
            free = on_its_place(post, line) and is_apart(post, (*arrangement.signs, *others))
            if free and in_sight(task, arrangement.start, post):
                hung = [*found, (post, *swap)]
                ours = tuple(replace(p, code=code, value=value) for p, (code, value), _ in hung)
                theirs = tuple(replace(p, code=code, value=value) for p, _, (code, value) in hung)
                if can_stand([ours, theirs], halves):
                    yield post


def _sent(task: SceneTask, arrangement: Arrangement, held: Sequence[_Held], roads: PlateRoads) -> Sent | None:
    """Other traffic as the plates on some posts send it in both halves; None where it could not go on.

    An approach from which the two halves' plates permit no common way is not used, nor is a road from which only
    ways onto the ego's are left: all its traffic would stand where the ego turns.
    """
    graph, catalog = task.graph, task.recipe.catalog
    avoid, closed = set(arrangement.avoid_turns), set(arrangement.closed_edges)
    ego = {*arrangement.route_hint, *arrangement.compliant_hint}
    shut: list[tuple[str, ...]] = []
    for post, *plates in held:
        options = [catalog.sign(code).rule.options for code, _ in plates]
        allowed = [set(option["allowed"]) for option in options if "allowed" in option]
        if not allowed:
            continue
        ahead = roads.approach(edge=post.edge, s=post.position_m)
        behind = roads.back(edge=post.edge, s=post.position_m)
        approach = ahead.edges[-1]
        permitted = set.intersection(*allowed)
        turns = {(approach, e) for e in graph.successors(approach)}
        avoid |= {turn for turn in turns if graph.turn(*turn) not in permitted}
        if turns <= avoid:
            shut.append((*behind.edges[::-1], *ahead.edges))
    return shut_roads(roads, shut, ego=ego, sent=Sent(frozenset(avoid), frozenset(closed)))


def _with_same_limits(task: SceneTask, signed: Arrangement, contrast: Arrangement) -> tuple[Arrangement, Arrangement]:
    """The other half's limit and an end, so that which end is in sight does not tell which limit binds the ego.

    No end stands ahead of the ego. Facing the other direction stand, in the signed half, an end of its limit and then
    the other limit, and in the other half its limit with its end. Raises UnfitMapError where there is no room.
    """
    (a, end_a), (b, _) = ([(s.code, s.value) for s in half.signs] for half in (signed, contrast))
    signed, contrast = (replace(half, signs=half.signs[:1]) for half in (signed, contrast))
    edges = leading_to(task, signed)
    posts = facing_ego(task, signed, edges)
    if posts is None:
        raise UnfitMapError("no room for another limit and an end")
    return _on_posts(signed, contrast, [(posts[0], end_a, a), (posts[1], b, end_a)])


def _on_posts(signed: Arrangement, contrast: Arrangement, posts: Sequence[_Held]) -> tuple[Arrangement, Arrangement]:
    """Both halves with more posts: each with its plate in the signed half and the one in the other half."""
    ours = tuple(replace(post, code=code, value=value) for post, (code, value), _ in posts)
    theirs = tuple(replace(post, code=code, value=value) for post, _, (code, value) in posts)
    return replace(signed, signs=(*signed.signs, *ours)), replace(contrast, signs=(*contrast.signs, *theirs))


def _in_order(plates: Counter[_Plate]) -> list[_Plate]:
    return sorted(plates.elements(), key=lambda plate: (plate[0], plate[1] or 0.0))
