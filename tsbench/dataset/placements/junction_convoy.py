"""Pairs of paths through a junction that meet, and a convoy that is there when the ego is. Units: m, m/s, s.

Source: docs/scenes.md, "Priority at junctions".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from tsbench.dataset.placements.junction_arms import Arms
from tsbench.dataset.placements.placement import (
    ConvoySetup,
    SceneTask,
    UnfitMapError,
    passenger_lanes,
    start_speed,
)
from tsbench.geometry.angles import U_TURN
from tsbench.geometry.overlap import ConflictZone, conflict_zone
from tsbench.geometry.polyline import Polyline, bend_speed
from tsbench.roads.junction_paths import junction_path
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.world import EGO_WIDTH_M

_ONTO_EXIT_M = 15.0


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
    """Speeds (m/s) of an ego on its way through, and on its approach, of which it knows the class of road."""
    lane = task.network.lanes[c.from_lane]
    cruise = task.network.expected_speed(lane.edge)
    return task.recipe.number("ego_turn_ratio") * turn_speed(task.network, c), cruise


def line_lead(task: SceneTask, chosen: Conflict, speed: float) -> float:
    """So much later (s) than the ego a car of this speed has to reach the zone, at least, not to be at its line before.

    At its line it shows whether it gives way: who watches it must be at the own one by then.
    """
    turn, _ = ego_speeds(task, chosen.ego)
    return chosen.zone.b_in / speed - chosen.zone.a_in / turn + task.recipe.number("convoy_shows_s")


def conflicts(network: RoadNetwork, graph: LaneGraph, arms: Arms, slowest_turn: float) -> list[Conflict]:
    """Pairs of an ego path that SUMO makes wait and one with priority that it does not, whose strips overlap.

    slowest_turn: the ego's path can be driven at this speed (m/s) at least.
    """
    own = _links(network, graph, arms.ego_in)
    egos = [c for c in own if c.state in "ms" and turn_speed(network, c) >= slowest_turn]
    with_priority = [c for e in arms.prior_in for c in _links(network, graph, e) if c.state == "M"]
    # One pair per pair of edges: lanes of the same roads are no different scene.
    unique: dict[tuple[str, str, str], Conflict] = {}
    for ego in egos:
        for priority in with_priority:
            zone = meeting(network, ego, priority)
            if zone is None:
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
        if network.lanes[c.to_lane].permits("passenger")
        and graph.turn(edge, network.lanes[c.to_lane].edge) != U_TURN
    ]


def convoy(task: SceneTask, chosen: Conflict) -> ConvoySetup:
    """One to two cars, the lead so far away that it needs a little less time than the ego and what it comes later.

    Raises UnfitMapError.
    """
    network, recipe, rng = task.network, task.recipe, task.rng
    priority_lane, ego_lane = network.lanes[chosen.priority.from_lane], network.lanes[chosen.ego.from_lane]
    turn, cruise = ego_speeds(task, chosen.ego)
    to_line = recipe.number("ego_before_line_m")
    v0 = start_speed(task, ego_lane)
    eta = predicted_arrival(to_line, to_line + chosen.zone.a_in, v0, cruise, turn)
    speed = float(rng.uniform(recipe.number("convoy_least_mps"), recipe.number("convoy_most_mps")))
    accel = recipe.number("convoy_accel_mps2")
    least, most = recipe.number("convoy_least_after_s"), recipe.number("convoy_most_after_s")
    after = max(float(rng.uniform(least, most)), line_lead(task, chosen, speed))
    body = replace(
        task.drivers[0], speed=speed, accel=accel, decel=recipe.number("convoy_decel_mps2"), headway=1.2, gap=2.0,
        length=4.5, width=1.85,
    )  # fmt: skip
    reach = _reach(recipe.number("convoy_time_share") * eta + after, speed, 0.8 * accel)
    back = min(
        max(reach - chosen.zone.b_in, recipe.number("convoy_nearest_m")),
        priority_lane.line.length - body.length - 1.0,
        recipe.number("convoy_farthest_m"),
    )
    lead = priority_lane.line.length - back
    count = int(rng.integers(1, int(recipe.number("convoy_most")) + 1))
    step = body.length + recipe.number("convoy_gap_m")
    places = tuple(lead - k * step for k in range(count) if lead - k * step > body.length + 0.5)
    if not places:
        raise UnfitMapError(f"the main arm of {priority_lane.line.length:.0f} m has no room for a convoy")
    return ConvoySetup(
        drivers=tuple(body for _ in places), places=places, lane=priority_lane.id,
        edges=(priority_lane.edge, network.lanes[chosen.priority.to_lane].edge),
        zone_m=priority_lane.line.length + chosen.zone.b_in, line_lane=ego_lane.id, ego_zone_m=chosen.zone.a_in,
        ego_cruise_mps=cruise, ego_turn_mps=turn, after_s=after, abrupt=True,
    )  # fmt: skip


def _reach(time: float, speed: float, accel: float) -> float:
    """Way that a car from standstill covers: a ramp up to its cruise speed, then on with that."""
    ramp = min(speed / accel, time)
    return 0.5 * accel * ramp * ramp + speed * (time - ramp)
