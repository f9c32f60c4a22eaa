"""Plates that bind others, or nobody, on the way: what stands there is no answer. Source: docs/spec/contrast.md.

Units: m.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from tsbench.core.benchmark import SIGN_RANGE_M
from tsbench.dataset.placements.placement import (
    Arrangement,
    SceneTask,
    UnfitMapError,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.dataset.scenes.driven_plates import broken_plates
from tsbench.dataset.scenes.plate_places import PlacedPlates
from tsbench.geometry.polyline import Polyline
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.catalog import ScenarioType, load_catalog
from tsbench.sim.world import EGO_LENGTH_M

# Room before an arm's line and behind its start, and from post to post.
_CLEAR_M = 15.0
_AT_LINE_M = 2.0
_APART_M = 8.0
_OFF_M = 0.5
# So far from the height of a zone's end the other direction's may stand.
BESIDE_M = 5.0
# Of a plate that ended before the ego's start: from the start of the road, and behind the ego's rear.
_BEHIND_M = 2.0
# Places that are tried on each edge; at a junction, where the post must be in sight from the ego's line, too.
_TRIES, _TRIES_AT_JUNCTION = 4, 16
# How often a limit that is over stands behind the ego, and not the plate of an obstacle.
_LIMITS_SHARE = 0.6

_Plate = tuple[str, float | None]


def with_same_plates(
    task: SceneTask, signed: Arrangement, contrast: Arrangement
) -> tuple[Arrangement, Arrangement]:
    """Both halves with posts more, so that they have the same plates: only where each stands differs.

    What would hang in one half alone hangs in the other on a post that binds nobody who is watched, in sight from the
    ego's start: at a junction on roads that lead away from it, in sight from the ego's line too; else on roads that
    lead to the ego's way or run against it, for routing, where these are too few, also on roads that lead away; on a
    one-way road behind the ego, if it is over there, as the plate of an obstacle is. Where there is no room for all,
    the rest stay different. For limits that end see `_with_same_limits`.
    """
    ours, theirs = (Counter((s.code, s.value) for s in half.signs) for half in (signed, contrast))
    swaps = list(zip(_in_order(theirs - ours), _in_order(ours - theirs), strict=True))
    if any(_ends(code) for (code, _), _ in swaps):
        return _with_same_limits(task, signed, contrast)
    edges = _leading_away(task, signed) if task.row.family == "junction" else _leading_to(task, signed)
    posts = _posts(task, signed, edges, len(swaps), within_m=SIGN_RANGE_M)
    if len(posts) < len(swaps) and task.row.family == "dual_path":
        posts = _posts(
            task, signed, [*edges, *_leading_away(task, signed)], len(swaps), within_m=SIGN_RANGE_M
        )
    if len(posts) < len(swaps) and _at_obstacle(swaps[-1][0][0]):
        posts = _behind(task, signed, len(swaps))
    posts.sort(key=lambda post: (post.edge, post.position_m))
    return _on_posts(signed, contrast, [(post, *plates) for post, plates in zip(posts, swaps, strict=False)])


def _with_same_limits(
    task: SceneTask, signed: Arrangement, contrast: Arrangement
) -> tuple[Arrangement, Arrangement]:
    """The other half's limit and its end, so that which end is in sight does not tell which limit binds the ego.

    On a road with two directions both face the other one: the limit in sight from the start, its end beside the end of
    the ego's zone, so that both ends come into sight together. On a one-way road no end stands ahead. Behind the ego
    stand, in the signed half, an end of its limit and then the other limit, which is no lower than the road's own, and
    in the other half its limit with its end. Raises UnfitMapError where there is no room.
    """
    (a, end_a), (b, end_b) = ([(s.code, s.value) for s in half.signs] for half in (signed, contrast))
    edges = _leading_to(task, signed)
    if edges:
        limit = _posts(task, signed, edges, 1, within_m=SIGN_RANGE_M)
        require(bool(limit), "no room for the other direction's limit")
        end = _beside(task, signed, edges, signed.signs[1], limit[0])
        return _on_posts(signed, contrast, [(limit[0], b, a), (end, end_b, end_a)])
    signed, contrast = (replace(half, signs=half.signs[:1]) for half in (signed, contrast))
    posts = _behind(task, signed, 2)
    require(len(posts) == 2, "no room behind the ego for another limit")
    return _on_posts(signed, contrast, [(posts[0], end_a, a), (posts[1], b, end_a)])


def _on_posts(
    signed: Arrangement, contrast: Arrangement, posts: Sequence[tuple[SignInstance, _Plate, _Plate]]
) -> tuple[Arrangement, Arrangement]:
    """Both halves with more posts: each with its plate in the signed half and the one in the other half."""
    ours = tuple(replace(post, code=code, value=value) for post, (code, value), _ in posts)
    theirs = tuple(replace(post, code=code, value=value) for post, _, (code, value) in posts)
    return replace(signed, signs=(*signed.signs, *ours)), replace(contrast, signs=(*contrast.signs, *theirs))


def distractors(
    task: SceneTask, arrangement: Arrangement, halves: Sequence[PlacedPlates]
) -> tuple[SignInstance, ...]:
    """As many as the variant asks for and the map has places for, of codes that are not the scene's.

    They face who comes towards the ego, or on roads that lead to its way from the side; the ego drives none of these.
    On a one-way road they stand behind the ego, and are over: an end, or a limit with its end.

    halves: of the scene; in each a plate can stand where it stands, and no vehicle breaks it.
    """
    wanted, taken = task.variant.distractors, {s.code for s in arrangement.signs}
    kinds = [
        kind for kind in load_catalog().types if kind.group != "priority" and taken.isdisjoint(kind.codes)
    ]
    edges = _leading_to(task, arrangement)
    if not edges and task.row.family == "corridor":
        return _over(task, kinds, _behind(task, arrangement, wanted), halves)
    codes = [code for kind in kinds for code in kind.codes]
    found: list[SignInstance] = []
    while len(found) < wanted:
        plate = _fitting(task, arrangement, edges, codes, tuple(found), halves)
        if plate is None:
            break
        found.append(plate)
    return tuple(found)


def _fitting(
    task: SceneTask, arrangement: Arrangement, edges: Sequence[str], codes: Sequence[str],
    found: tuple[SignInstance, ...], halves: Sequence[PlacedPlates],
) -> SignInstance | None:  # fmt: skip
    """A plate of the first of the codes, in a drawn order, that can stand on one of the edges; None: there is none."""
    for code in _shuffled(codes, task):
        for edge in _shuffled(edges, task):
            line = task.network.edge_lanes(edge)[0].line
            post = _post(task, arrangement, edge, _place(code, line.length, task), len(found))
            if _on_its_place(post, line) and _is_apart(post, (*arrangement.signs, *found)):
                for plate in _bearings(post, code, task):
                    if _can_stand((*found, plate), halves):
                        return plate
    return None


def _place(code: str, length: float, task: SceneTask) -> float:
    """Where along an edge a plate stands: as far from the line or the junction as the sign may, else anywhere."""
    placement = load_catalog().sign(code).placement
    if placement.reference == "line":
        return length - float(task.rng.uniform(_AT_LINE_M, min(placement.distance_m[1], _CLEAR_M)))
    if placement.reference == "exit_start":
        return float(task.rng.uniform(*placement.distance_m))
    return float(task.rng.uniform(_CLEAR_M, length - _CLEAR_M))


def _can_stand(plates: tuple[SignInstance, ...], halves: Sequence[PlacedPlates]) -> bool:
    """Can all of these stand in both halves, and does no vehicle break one?"""
    for half in halves:
        scene = replace(half, plates=(*half.plates, *plates))
        if any(scene.refused(plate) for plate in plates):
            return False
        if any(p in plates for v in scene.vehicles for p, _ in broken_plates(scene, v)):
            return False
    return True


def _over(
    task: SceneTask,
    kinds: Sequence[ScenarioType],
    posts: Sequence[SignInstance],
    halves: Sequence[PlacedPlates],
) -> tuple[SignInstance, ...]:
    """The posts with plates that no longer hold behind them: limits with their ends, and ends alone."""
    limits = {kind.codes[0]: kind.end_codes[0] for kind in kinds if kind.end_codes}
    found: tuple[SignInstance, ...] = ()
    for post, after in zip_longest(posts, posts[1:]):
        if found and found[-1].code in limits:
            found = (*found, replace(post, code=limits[found[-1].code], value=found[-1].value))
            continue
        paired = after is not None and task.rng.random() < _LIMITS_SHARE
        for code in _shuffled(tuple(limits), task):
            # A limit is tried with its end, which the next post then bears.
            plates = _bearings(post, code if paired else limits[code], task)
            ends = [
                (replace(after, code=limits[code], value=p.value),) if paired and after else ()
                for p in plates
            ]
            fit = [p for p, end in zip(plates, ends, strict=True) if _can_stand((*found, p, *end), halves)]
            if fit:
                found = (*found, fit[0])
                break
    return found


def _shuffled(words: Sequence[str], task: SceneTask) -> list[str]:
    return [words[int(k)] for k in task.rng.permutation(len(words))]


def _bearings(post: SignInstance, code: str, task: SceneTask) -> list[SignInstance]:
    """The post with a plate, once for each value that the sign may post, in a drawn order."""
    value = load_catalog().sign(code).value
    if value is None:
        return [replace(post, code=code, value=None)]
    order = task.rng.permutation(len(value.allowed)).tolist()
    return [replace(post, code=code, value=float(value.allowed[k])) for k in order]


def _ends(code: str) -> bool:
    return load_catalog().sign(code).is_end


def _at_obstacle(code: str) -> bool:
    return load_catalog().sign(code).rule.name == "detour"


def _in_order(plates: Counter[_Plate]) -> list[_Plate]:
    return sorted(plates.elements(), key=lambda plate: (plate[0], plate[1] or 0.0))


def _posts(
    task: SceneTask, arrangement: Arrangement, edges: Sequence[str], count: int, within_m: float
) -> list[SignInstance]:
    """Up to `count` posts beside edges, spread over them and apart from all others.

    within_m: of the ego's start, at a junction of its line, too.
    """
    found: list[SignInstance] = []
    way = task.network.lane(arrangement.start.lane).line
    at_junction = task.row.family == "junction"
    seen_from = [way.point_at(s) for s in (arrangement.start.s, *((way.length,) if at_junction else ()))]
    order = [edges[int(k)] for k in task.rng.permutation(len(edges))]
    for edge in order * (_TRIES_AT_JUNCTION if at_junction else _TRIES):
        if len(found) == count:
            break
        line = task.network.edge_lanes(edge)[0].line
        post = _post(
            task, arrangement, edge, float(task.rng.uniform(_CLEAR_M, line.length - _CLEAR_M)), len(found)
        )
        near = all(math.dist(place, (post.x, post.y)) < within_m for place in seen_from)
        if _on_its_place(post, line) and near and _is_apart(post, (*arrangement.signs, *found)):
            found.append(post)
    return found


def _on_its_place(post: SignInstance, line: Polyline) -> bool:
    """In a bend a post may stand beside another place of its road than it is meant for."""
    return abs(line.project(post.x, post.y)[0] - post.position_m) < _OFF_M


def _is_apart(post: SignInstance, others: Sequence[SignInstance]) -> bool:
    return all(math.dist((post.x, post.y), (other.x, other.y)) > _APART_M for other in others)


def _beside(
    task: SceneTask, arrangement: Arrangement, edges: Sequence[str], sign: SignInstance, other: SignInstance
) -> SignInstance:
    """A post on one of the edges at the height of a sign or a little off it, apart from all of them and another.

    Raises UnfitMapError where there is no room.
    """
    off = float(task.rng.uniform(-BESIDE_M, BESIDE_M))
    for edge in edges:
        line = task.network.edge_lanes(edge)[0].line
        s = line.project(sign.x, sign.y)[0] + off
        if BESIDE_M < s < line.length - BESIDE_M:
            post = _post(task, arrangement, edge, s, 1)
            if _is_apart(post, (*arrangement.signs, other)):
                return post
    raise UnfitMapError("no room for an end of the other direction's limit beside the zone's")


def _behind(task: SceneTask, arrangement: Arrangement, count: int) -> list[SignInstance]:
    """Up to `count` posts on the ego's own road that it has passed before its start, apart from all others."""
    edge = task.network.lane(arrangement.start.lane).edge
    rear = arrangement.start.s - EGO_LENGTH_M / 2
    posts = [
        _post(task, arrangement, edge, s, 0)
        for s in np.arange(_BEHIND_M, rear - _BEHIND_M, _APART_M).tolist()
    ]
    free = [p for p in posts if all(math.dist((p.x, p.y), (q.x, q.y)) >= _APART_M for q in arrangement.signs)]
    chosen = sorted(task.rng.permutation(len(free))[:count].tolist())
    return [_post(task, arrangement, edge, free[n].position_m, k) for k, n in enumerate(chosen)]


def _post(task: SceneTask, arrangement: Arrangement, edge: str, s: float, k: int) -> SignInstance:
    """The k-th post beyond those of an arrangement, its plate not yet chosen."""
    number, code = len(arrangement.signs) + k, arrangement.signs[0].code
    return plate_beside(task.network, code, edge, s, number=number, role=DISTRACTOR)


def _leading_to(task: SceneTask, arrangement: Arrangement) -> list[str]:
    """Edges with cars, on none of the ego's ways, that lead to it from the side or run against it."""
    edges, graph = task.network.edges, task.graph
    near = {n for e in arrangement.route_hint for n in (edges[e].source, edges[e].target)}
    ends = {(edges[e].source, edges[e].target) for e in _ways(arrangement)}

    def leads(name: str) -> bool:
        against = edges[name].source in near and (edges[name].target, edges[name].source) in ends
        return against or (edges[name].target in near and bool(graph.successors(name)))

    # A corridor has no roads but its own two directions, a ring none but its arms.
    if task.row.family in ("corridor", "roundabout"):
        return list(_others(task, arrangement))
    return [name for name in _others(task, arrangement) if leads(name)]


def _leading_away(task: SceneTask, arrangement: Arrangement) -> list[str]:
    """Edges with cars, on none of the ego's ways, by which others leave the first junction."""
    edges = task.network.edges
    junction = edges[arrangement.route_hint[0]].target
    return [name for name in _others(task, arrangement) if edges[name].source == junction]


def _ways(arrangement: Arrangement) -> set[str]:
    return {*arrangement.route_hint, *arrangement.compliant_hint}


def _others(task: SceneTask, arrangement: Arrangement) -> Iterator[str]:
    """Edges with cars that have room for a post, in a fixed order, but those of the ego's ways."""
    network, ways = task.network, _ways(arrangement)
    for name in sorted(network.edges.keys() - ways):
        long_enough = network.edge_lanes(name)[0].line.length > 2.0 * _CLEAR_M
        if long_enough and not network.edges[name].internal and passenger_lanes(network, name):
            yield name
