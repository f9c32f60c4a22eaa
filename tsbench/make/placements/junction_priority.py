"""Roles of a junction's arms: which are the main road, on which the ego comes, to which it gives way.

Where its path meets one of theirs, a convoy is there when the ego is.
Source: docs/scenes.md, "Priority at junctions"; docs/rules.md, "Give way" (vehicles with priority). Units: m, m/s, s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from tsbench.geometry.elementary import STRAIGHT_DEG, U_TURN
from tsbench.geometry.overlap import ConflictZone, conflict_zone
from tsbench.geometry.polyline import Polyline, bend_speed
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.placement import ConvoySetup, SceneTask, passenger_lanes, require, start_speed
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.seeds import seed_of
from tsbench.roads.junction_paths import junction_path
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.sim.convoy import KEEPS_BACK_S, predicted_arrival
from tsbench.sim.junction_traffic import HOLD_BEFORE_LINE_M, HOLD_BRAKE_MPS2
from tsbench.sim.world import EGO_WIDTH_M

_CLASSES = ("primary", "secondary", "tertiary", "unclassified", "residential", "living_street", "service")

Arm = dict[str, Any]
_ONTO_EXIT_M = 15.0
_LENGTH_M = 4.5
_FIRST_ENTRY_S = 1.0
# Least and most share of what the class of a convoy's road allows.
SHARES = "convoy_least_share", "convoy_most_share"
# Least and most time from the ego in the zone to a convoy that goes first.
AFTER_S = "convoy_least_after_s", "convoy_most_after_s"


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


@dataclass(frozen=True)
class Conflict:
    """A pair of paths that meet: the ego's connection, the other's, and their zone (a = ego, b = the other)."""

    ego: Connection
    priority: Connection
    zone: ConflictZone


def swept_line(network: RoadNetwork, c: Connection) -> Polyline:
    """A connection's line through the junction with the first 15 m of the exit lane: cars meet there, too."""
    return junction_path(network, c).onto_exit(_ONTO_EXIT_M)


def meeting(network: RoadNetwork, ego: Connection, priority: Connection) -> ConflictZone | None:
    """Where the ego's body on its path (a) is in the other's lane (b)."""
    width = junction_path(network, priority).width
    return conflict_zone(swept_line(network, ego), EGO_WIDTH_M, swept_line(network, priority), width)


def turn_speed(network: RoadNetwork, c: Connection) -> float:
    """Speed (m/s) at which a careful driver takes a connection: 2 m/s2 sideways on its tightest stretch."""
    line = swept_line(network, c)
    return 8.0 if line.length < 4.0 else min(bend_speed(line, 2.0), 14.0)


def ego_speeds(task: SceneTask, c: Connection) -> tuple[float, float]:
    """Speeds (m/s) of an ego on its way through, and on its approach by the class of its road."""
    lane = task.network.lanes[c.from_lane]
    cruise = task.network.expected_speed(lane.edge)
    return task.recipe.number("ego_turn_ratio") * turn_speed(task.network, c), cruise


def convoy_speed(task: SceneTask, chosen: Conflict, share: float) -> float:
    """A share of the speed (m/s) of the convoy's road, slower where its arm is too short to stop on from that."""
    lane = task.network.lanes[chosen.priority.from_lane]
    room = max(lane.line.length - _LENGTH_M - HOLD_BEFORE_LINE_M, 1.0)
    return min(share * task.network.expected_speed(lane.edge), math.sqrt(2.0 * HOLD_BRAKE_MPS2 * room))


def line_lead(task: SceneTask, chosen: Conflict, speed: float) -> float:
    """So much later (s) than the ego a car of this speed has to reach the zone, at least, not to be at its line before.

    At its line it shows whether it gives way: an ego that watches it must be at its own by then, and is in the zone so
    much earlier that the convoy need not slow down for it.
    """
    turn, _ = ego_speeds(task, chosen.ego)
    shown = task.recipe.number("convoy_shows_s") - chosen.zone.a_in / turn
    return chosen.zone.b_in / speed + max(shown, KEEPS_BACK_S)


def how_late(task: SceneTask, one: Conflict, other: Conflict) -> tuple[float, float] | None:
    """How long after the ego on one way a convoy may be in the zone, s, so that it suits the other way as well."""
    least, most = (task.recipe.number(name) for name in AFTER_S)
    to_line = task.recipe.number("ego_before_line_m")
    speeds, lates = [], []
    for c in (one, other):
        turn, cruise = ego_speeds(task, c.ego)
        v0 = start_speed(task, task.network.lanes[c.ego.from_lane])
        speeds.append(convoy_speed(task, c, task.recipe.number(SHARES[0])))
        eta = predicted_arrival(to_line, to_line + c.zone.a_in, v0, cruise, turn)
        lates.append(c.zone.b_in / speeds[-1] - eta)
    later = lates[1] - lates[0]
    leads = [line_lead(task, c, speed) for c, speed in zip((one, other), speeds, strict=True)]
    first, last = max(least, least - later, leads[0], leads[1] - later), min(most, most - later)
    return (first, last) if first <= last else None


def conflicts(
    network: RoadNetwork, graph: LaneGraph, arms: Arms, *, slowest_turn: float, most_to_zone: float
) -> list[Conflict]:
    """Pairs of an ego path that SUMO makes wait and one with priority that it does not, whose strips overlap.

    slowest_turn: the ego's path can be driven at this speed (m/s) at least. most_to_zone: the overlap begins at most so
    far (m) behind the other's line.
    """
    own = _links(network, graph, arms.ego_in)
    egos = [c for c in own if c.state in "ms" and turn_speed(network, c) >= slowest_turn]
    with_priority = [c for e in arms.prior_in for c in _links(network, graph, e) if c.state == "M"]
    # One pair per pair of edges: lanes of the same roads are no different scene.
    unique: dict[tuple[str, str, str], Conflict] = {}
    for ego in egos:
        for priority in with_priority:
            zone = meeting(network, ego, priority)
            if zone is None or zone.b_in > most_to_zone:
                continue
            lanes = network.lanes
            key = (lanes[ego.to_lane].edge, lanes[priority.from_lane].edge, lanes[priority.to_lane].edge)
            if key not in unique or zone.a_in > unique[key].zone.a_in:
                unique[key] = Conflict(ego, priority, zone)
    return [unique[k] for k in sorted(unique)]


def _links(network: RoadNetwork, graph: LaneGraph, edge: str) -> list[Connection]:
    """The connections of an edge that cars may take, but for turning round."""
    return [
        c
        for lane in passenger_lanes(network, edge)
        for c in network.outgoing[lane.index]
        if network.lanes[c.to_lane].permits("passenger") and graph.turn(edge, network.lanes[c.to_lane].edge) != U_TURN
    ]


def link(network: RoadNetwork, lane: str, edge: str) -> Connection:
    """The connection from a lane to an edge. Raises UnfitMapError where other plates lead the lane elsewhere."""
    links = network.outgoing[network.lane_index[lane]]
    found = [c for c in links if network.lanes[c.to_lane].edge == edge]
    require(bool(found), f"lane {lane} does not lead to {edge}")
    return found[0]


def gives_way(connection: Connection, other: Connection) -> bool:
    """Does it wait for another one that does not wait for it?"""
    return not connection.yields_to.isdisjoint(other.via) and other.yields_to.isdisjoint(connection.via)


def convoy(task: SceneTask, chosen: Conflict) -> ConvoySetup:
    """One to two cars that enter at the start of their arm, at their cruise speed, when the ego is near enough.

    Raises UnfitMapError.
    """
    network, recipe, rng = task.network, task.recipe, task.rng
    priority_lane, ego_lane = network.lanes[chosen.priority.from_lane], network.lanes[chosen.ego.from_lane]
    arm_m = priority_lane.line.length
    require(arm_m - _LENGTH_M >= recipe.number("convoy_least_m"), f"the convoy's arm is {arm_m:.0f} m long")
    turn, cruise = ego_speeds(task, chosen.ego)
    to_line = recipe.number("ego_before_line_m")
    v0 = start_speed(task, ego_lane)
    eta = predicted_arrival(to_line, to_line + chosen.zone.a_in, v0, cruise, turn)
    speed = convoy_speed(task, chosen, float(rng.uniform(recipe.number(SHARES[0]), recipe.number(SHARES[1]))))
    least, most = (recipe.number(name) for name in AFTER_S)
    after = max(float(rng.uniform(least, most)), line_lead(task, chosen, speed))
    body = replace(
        task.drivers[0],
        speed=speed,
        accel=recipe.number("convoy_accel_mps2"),
        decel=recipe.number("convoy_decel_mps2"),
        headway=1.2,
        gap=2.0,
        length=_LENGTH_M,
        width=1.85,
    )
    count = int(rng.integers(1, int(recipe.number("convoy_most")) + 1))
    way = arm_m + chosen.zone.b_in - body.length
    first = max(round(eta + after - way / speed, 1), _FIRST_ENTRY_S)
    step = body.headway + (body.length + body.gap) / speed
    return ConvoySetup(
        drivers=(body,) * count, places=(body.length,) * count, lane=priority_lane.id,
        edges=(priority_lane.edge, network.lanes[chosen.priority.to_lane].edge),
        zone_m=arm_m + chosen.zone.b_in, line_lane=ego_lane.id, ego_zone_m=chosen.zone.a_in,
        ego_cruise_mps=cruise, ego_turn_mps=turn, after_s=after, keeps_back=True, abrupt=True,
        departs=tuple(round(first + k * step, 1) for k in range(count)),
    )  # fmt: skip
