"""Roles of a junction's arms: which are the main road, on which the ego comes, to which it gives way.

Source: docs/scenes.md, "Priority at junctions"; docs/rules.md, "Give way" (vehicles with priority).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from tsbench.geometry.angles import STRAIGHT_DEG
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.placement import require
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.seeds import seed_of
from tsbench.scenarios.map_pool import PoolRow

_CLASSES = ("primary", "secondary", "tertiary", "unclassified", "residential", "living_street", "service")

Arm = dict[str, Any]


@dataclass(frozen=True)
class Arms:
    """Edges by role.

    ego_in: the ego's edge towards the junction. prior_in: the edges towards it that have priority over the ego's.
    minor_in: those of the other secondary arms. main: the main road's edges in both directions. bends: the ego is
    on the main road itself, which bends.
    """

    ego_in: str
    prior_in: tuple[str, ...]
    minor_in: tuple[str, ...]
    main: frozenset[str]
    bends: bool


def through_arms(row: PoolRow, approach_m: float) -> Arms:
    """Main arms: the through pair of the higher class. The ego's: the longest other arm that leads in.

    Raises UnfitMapError.
    """
    arms: list[Arm] = row.fields["arms"]
    pairs = [tuple(p) for p in row.fields["through"]]
    require(bool(pairs), "no two arms go straight on")
    pair = min(pairs, key=lambda p: (sorted(_rank(arms[i]) for i in p), p))
    main, rest = [arms[i] for i in pair], [a for i, a in enumerate(arms) if i not in pair]
    entries = [a for a in rest if a["in_edge"]]
    require(bool(entries), "no secondary arm leads into the junction")
    ego = max(entries, key=lambda a: (float(a["length_m"]), str(a["in_edge"])))
    require(float(ego["length_m"]) >= approach_m, f"the secondary arm is {ego['length_m']:.0f} m long")
    return Arms(
        ego_in=ego["in_edge"],
        prior_in=tuple(a["in_edge"] for a in main if a["in_edge"]),
        minor_in=tuple(a["in_edge"] for a in entries if a is not ego),
        main=_edges(main),
        bends=False,
    )


def bending_arms(row: PoolRow, approach_m: float) -> Arms:
    """Main arms: two neighbours of the highest class, the ego on the left one, so that the other is to its right.

    Which pair of equal classes it is, is drawn by map. Raises UnfitMapError.
    """
    arms: list[Arm] = row.fields["arms"]
    pairs = []
    for ego in arms:
        # Arms are in counter-clockwise order: the next arm is to the right of a vehicle that drives in.
        turn, right = min((_turn(ego, a), k) for k, a in enumerate(arms) if a is not ego)
        long_enough = ego["in_edge"] and float(ego["length_m"]) >= approach_m
        # Arms farther apart go straight on: a main road over them does not bend.
        if long_enough and arms[right]["in_edge"] and turn < 180.0 - STRAIGHT_DEG:
            pairs.append((ego, arms[right]))
    require(bool(pairs), f"no arm of {approach_m:.0f} m has an arm to its right")
    main = min(pairs, key=lambda p: (sorted(map(_rank, p)), seed_of("bend", row.map_id, p[0]["in_edge"])))
    rest = [a for a in arms if a not in main]
    return Arms(
        ego_in=main[0]["in_edge"],
        prior_in=(main[1]["in_edge"],),
        minor_in=tuple(a["in_edge"] for a in rest if a["in_edge"]),
        main=_edges(main),
        bends=True,
    )


def exchanged_arms(row: PoolRow, arms: Arms) -> Arms:
    """The roles after an exchange of plates: the ego comes on the main road, and who went first gives way to it.

    The main road leads on into the arm that lies straightest ahead of the ego, of those that gave way before, or ends
    here.
    """
    every: list[Arm] = row.fields["arms"]
    ego = next(a for a in every if a["in_edge"] == arms.ego_in)
    free = [a for a in every if a is not ego and not _edges([a]) & arms.main]
    ahead = sorted(free, key=lambda a: abs(_turn(ego, a) - 180.0))[:1]
    main = _edges([ego, *ahead])
    return Arms(
        ego_in=arms.ego_in,
        # Oncoming vehicles have priority over the ego's left turns, vehicles from the right over all its turns.
        prior_in=tuple(a["in_edge"] for a in ahead if a["in_edge"] and _turn(ego, a) < 180.0 + STRAIGHT_DEG),
        minor_in=tuple(a["in_edge"] for a in every if a["in_edge"] and a["in_edge"] not in main),
        main=main,
        bends=not any(abs(_turn(ego, a) - 180.0) <= STRAIGHT_DEG for a in ahead),
    )


def with_priorities(row: PoolRow, plain: PlainNet, arms: Arms, recipe: Recipe, minor_stops: bool) -> PlainNet:
    """The crop with right of way as the plates state it.

    Where the main road bends, the right-hand rule among its arms is one step of priority more for the arm on the
    right (the ego's, where nobody has priority over it), and the junction goes by priorities alone: netconvert would
    let straight on go before turns.
    """
    main, low = int(recipe.number("main_priority")), int(recipe.number("secondary_priority"))
    priority = dict.fromkeys(arms.main, main)
    if arms.bends:
        priority |= dict.fromkeys(arms.prior_in or (arms.ego_in,), main + 1)
    node = row.fields["node"]
    kind, by = "priority_stop" if minor_stops else "priority", "edgePriority" if arms.bends else ""
    return replace(
        plain,
        nodes=tuple(replace(n, type=kind, right_of_way=by) if n.id == node else n for n in plain.nodes),
        edges=tuple(replace(e, priority=priority.get(e.id, low)) for e in plain.edges),
    )


def _turn(a: Arm, b: Arm) -> float:
    """Degrees counter-clockwise from one arm to another, 0 to 360."""
    return (float(b["heading_deg"]) - float(a["heading_deg"])) % 360.0


def _rank(arm: Arm) -> tuple[int, int]:
    name = str(arm["class"])
    return (_CLASSES.index(name) if name in _CLASSES else len(_CLASSES), -int(arm["lanes_in"]) - int(arm["lanes_out"]))


def _edges(arms: list[Arm] | tuple[Arm, ...]) -> frozenset[str]:
    return frozenset(a[k] for a in arms for k in ("in_edge", "out_edge") if a[k])
