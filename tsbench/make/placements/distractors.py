"""Plates on the way that do not bind the ego: what stands there is no answer. Source: docs/contrast.md.

Units: m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from tsbench.make.placements.placement import Arrangement, SceneTask
from tsbench.make.placements.posts import (
    bare_post,
    can_stand,
    is_apart,
    leading_to,
    on_its_place,
    place_along,
    shuffled,
)
from tsbench.make.scenes.placed_plates import PlacedPlates
from tsbench.signs.annotations import SignInstance

# Rules of plates that are no distractors: traffic is slower than 4.6 asks, and no lane is painted for 5.14.x.
_NEVER = ("min_speed", "reserved_lane")


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
                    if can_stand([(*found, plate)] * len(halves), halves):
                        return plate
    return None


def _bearings(post: SignInstance, code: str, task: SceneTask) -> list[SignInstance]:
    """The post with a plate, once for each value that the sign may post, in a drawn order."""
    value = task.recipe.catalog.sign(code).value
    if value is None:
        return [replace(post, code=code, value=None)]
    order = task.rng.permutation(len(value.allowed)).tolist()
    return [replace(post, code=code, value=float(value.allowed[k])) for k in order]
