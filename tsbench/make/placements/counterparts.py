"""The same plates in both halves of a pair: a plate of the one half alone hangs in the other where it binds others.

Source: docs/contrast.md. Units: m.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError, UnluckyDrawError
from tsbench.make.placements.posts import (
    TRIES,
    bare_post,
    beside_ways,
    can_stand,
    facing_ego,
    in_sight,
    is_apart,
    leading_to,
    on_its_place,
    place_along,
    shuffled,
)
from tsbench.make.scenes.placed_plates import PlacedPlates
from tsbench.make.scenes.plate_roads import PlateRoads
from tsbench.make.scenes.traffic import Sent, shut_roads
from tsbench.signs.annotations import SignInstance

_Plate = tuple[str, float | None]
_Swap = tuple[_Plate, _Plate]
_Held = tuple[SignInstance, _Plate, _Plate]


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
