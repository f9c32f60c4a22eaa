"""Junction scenes where the ego gives way: main arms, the ego's secondary arm, a convoy on a main arm.

Source: spec/scenes.md, "Arrangement per family" (Junction).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tsbench.geometry.overlap import ConflictZone, conflict_zone
from tsbench.geometry.polyline import Polyline
from tsbench.maps.network import Connection, Lane, RoadNetwork
from tsbench.maps.plain import PlainNet
from tsbench.maps.pool import PoolRow
from tsbench.scenarios.families.base import (
    Arrangement,
    ConvoySetup,
    SceneTask,
    UnfitMapError,
    before_line,
    beside_road,
    passenger_lanes,
    require,
    way_ahead,
)  # fmt: skip
from tsbench.scenarios.recipe import Recipe
from tsbench.signs.annotations import SignInstance
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.scene import Destination, EgoStart
from tsbench.sim.world import EGO_WIDTH_M

_CLASSES = ("primary", "secondary", "tertiary", "unclassified", "residential", "living_street", "service")


@dataclass(frozen=True)
class Arms:
    """Roles of a junction's arms: edges towards it and away from it, "" where there is none."""

    main_in: tuple[str, ...]
    main_out: tuple[str, ...]
    ego_in: str
    others_in: tuple[str, ...]


@dataclass(frozen=True)
class Conflict:
    """A pair of paths that meet: the ego's connection, the other's, and their zone (a = ego, b = the other)."""

    ego: Connection
    foe: Connection
    zone: ConflictZone


def _rank(arm: dict[str, Any]) -> tuple[int, int]:
    name = str(arm["class"])
    return (
        _CLASSES.index(name) if name in _CLASSES else len(_CLASSES),
        -int(arm["lanes_in"]) - int(arm["lanes_out"]),
    )


def assign_arms(row: PoolRow, approach_m: float) -> Arms:
    """Main arms: the through pair of the higher class. The ego's: the longest other arm that leads in."""
    fields = row.fields
    arms: list[dict[str, Any]] = fields["arms"]
    pairs = [tuple(p) for p in fields["through"]]
    require(bool(pairs), "no two arms go straight on")
    main = min(pairs, key=lambda p: (sorted(_rank(arms[i]) for i in p), p))
    rest = [a for i, a in enumerate(arms) if i not in main]
    entries = [a for a in rest if a["in_edge"]]
    require(bool(entries), "no secondary arm leads into the junction")
    ego = max(entries, key=lambda a: (float(a["length_m"]), str(a["in_edge"])))
    require(float(ego["length_m"]) >= approach_m, f"the secondary arm is {ego['length_m']:.0f} m long")
    return Arms(
        main_in=tuple(arms[i]["in_edge"] for i in main if arms[i]["in_edge"]),
        main_out=tuple(arms[i]["out_edge"] for i in main if arms[i]["out_edge"]),
        ego_in=ego["in_edge"],
        others_in=tuple(a["in_edge"] for a in entries if a is not ego),
    )


def connection_path(network: RoadNetwork, c: Connection) -> tuple[Polyline, float]:
    """A connection's line through the junction with the first 15 m of the exit lane, and its width."""
    exit_lane = network.lanes[c.to_lane]
    chunks = [network.lanes[v].line.points for v in c.via]
    chunks.append(exit_lane.line.slice(0.0, min(15.0, exit_lane.line.length)).points)
    width = min([network.lanes[v].width for v in c.via] or [exit_lane.width])
    return Polyline(np.vstack(chunks)), width


def turn_speed(network: RoadNetwork, c: Connection) -> float:
    """Speed (m/s) at which a careful driver takes a connection: 2 m/s2 sideways on its tightest stretch."""
    line, _ = connection_path(network, c)
    if line.length < 4.0:
        return 8.0
    headings = np.unwrap([line.heading_at(s) for s in np.arange(0.0, line.length, 2.0)])
    curvature = float(np.max(np.abs(headings[2:] - headings[:-2])) / 4.0) if len(headings) > 2 else 0.0
    return min(math.sqrt(2.0 / max(curvature, 1e-3)), 14.0)


class GiveWayPlacement:
    """`yield`: 2.4 at the ego's arm, the through pair is the main road."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """Priorities as the plates state them."""
        arms = assign_arms(row, recipe.number("ego_before_line_m"))
        main = set(arms.main_in) | set(arms.main_out)
        high, low = int(recipe.number("main_priority")), int(recipe.number("secondary_priority"))
        edges = tuple(replace(e, priority=high if e.id in main else low) for e in plain.edges)
        nodes = tuple(replace(n, type="priority") if n.id == row.fields["node"] else n for n in plain.nodes)
        return replace(plain, nodes=nodes, edges=edges)

    def arrange(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the line, a convoy timed to meet it."""
        row, network, graph, recipe, variant = task.row, task.network, task.graph, task.recipe, task.variant
        arms = assign_arms(row, recipe.number("ego_before_line_m"))
        options = _conflicts(network, graph, arms)
        require(bool(options), "no path of the ego meets one of the main road with priority")
        chosen = options[variant.layout % len(options)]
        lane = network.lanes[chosen.ego.from_lane]
        exit_lane = network.lanes[chosen.ego.to_lane]
        start = EgoStart(
            lane.id,
            before_line(lane, recipe.number("ego_before_line_m")),
            min(variant.initial_speed, lane.speed),
        )
        end_s = min(variant.route_length, exit_lane.line.length - recipe.number("end_before_edge_m"))
        require(end_s >= recipe.number("least_exit_m"), f"the exit arm is {exit_lane.line.length:.0f} m long")
        plate_s = lane.line.length - recipe.number("plate_before_line_m")
        x, y, heading = beside_road(network, lane.edge, plate_s)
        sign = SignInstance(
            id="sign_0", code=self.code, value=None, edge=lane.edge, lane=-1, position_m=plate_s, x=x, y=y, heading=heading,
            role="target",
            params={"junction": row.fields["node"], "approach": lane.edge, "main_in": " ".join(arms.main_in)},
        )  # fmt: skip
        route = (lane.edge, exit_lane.edge)
        require(graph.route(lane.edge, exit_lane.edge) == route, "the exit is not the next edge of the route")
        return Arrangement(
            signs=(sign,), target=sign.id, start=start, destination=Destination(exit_lane.edge, end_s),
            route_hint=route, route_length=end_s, convoy=_convoy(task, chosen),
            quiet_edges=frozenset({network.lanes[chosen.foe.from_lane].edge}),
            platoons=frozenset(arms.main_in), blocked=way_ahead(passenger_lanes(network, lane.edge), start),
        )  # fmt: skip


def _turn(graph: LaneGraph, c: Connection) -> str:
    lanes = graph.network.lanes
    return graph.turn(lanes[c.from_lane].edge, lanes[c.to_lane].edge)


def _conflicts(network: RoadNetwork, graph: LaneGraph, arms: Arms) -> list[Conflict]:
    """Pairs of an ego path that SUMO makes wait and a main-road path that it does not, whose strips overlap."""
    found = []
    ego_lanes = {lane.index for lane in passenger_lanes(network, arms.ego_in)}
    ego_links = [c for i in sorted(ego_lanes) for c in network.outgoing[i] if _turn(graph, c) != "u_turn"]
    foe_links = [
        c for e in arms.main_in for lane in passenger_lanes(network, e) for c in network.outgoing[lane.index]
    ]
    for ego in ego_links:
        if ego.state != "m" or not network.lanes[ego.to_lane].permits("passenger"):
            continue
        line, _ = connection_path(network, ego)
        for foe in foe_links:
            if foe.state != "M" or _turn(graph, foe) not in ("straight", "right"):
                continue
            foe_line, foe_width = connection_path(network, foe)
            zone = conflict_zone(line, EGO_WIDTH_M, foe_line, foe_width)
            if zone is not None:
                found.append(Conflict(ego, foe, zone))
    # One pair per pair of edges: lanes of the same roads are no different scene.
    unique: dict[tuple[str, str, str], Conflict] = {}
    for c in found:
        key = (
            network.lanes[c.ego.to_lane].edge,
            network.lanes[c.foe.from_lane].edge,
            network.lanes[c.foe.to_lane].edge,
        )
        if key not in unique or c.zone.a_in > unique[key].zone.a_in:
            unique[key] = c
    return [unique[k] for k in sorted(unique)]


def _convoy(task: SceneTask, chosen: Conflict) -> ConvoySetup:
    """One to two cars, the lead so far away that it needs a little less time than the ego."""
    network, recipe, variant, rng = task.network, task.recipe, task.variant, task.rng
    foe_lane: Lane = network.lanes[chosen.foe.from_lane]
    ego_lane = network.lanes[chosen.ego.from_lane]
    turn, cruise = turn_speed(network, chosen.ego), ego_lane.speed
    to_line = recipe.number("ego_before_line_m")
    v0 = min(variant.initial_speed, ego_lane.speed)
    eta = predicted_arrival(to_line, to_line + chosen.zone.a_in, v0, cruise, turn)
    speed = float(rng.uniform(recipe.number("convoy_least_mps"), recipe.number("convoy_most_mps")))
    accel = recipe.number("convoy_accel_mps2")
    share = recipe.number("convoy_time_share")
    body = replace(
        task.drivers[0], speed=speed, accel=accel, decel=3.0, headway=1.2, gap=2.0, length=4.5, width=1.85
    )
    room = foe_lane.line.length - body.length - 1.0
    # Distance that a car from standstill covers in a share of the ego's time: a ramp, then its cruise speed.
    ramp = speed / (0.8 * accel)
    reach = (
        0.5 * speed * ramp + speed * max(share * eta - ramp, 0.0)
        if share * eta > ramp
        else 0.4 * accel * (share * eta) ** 2
    )
    back = min(
        max(reach - chosen.zone.b_in, recipe.number("convoy_nearest_m")),
        room,
        recipe.number("convoy_farthest_m"),
    )
    lead = foe_lane.line.length - back
    count = int(rng.integers(1, int(recipe.number("convoy_most")) + 1))
    step = body.length + recipe.number("convoy_gap_m")
    places = tuple(lead - k * step for k in range(count) if lead - k * step > body.length + 0.5)
    if not places:
        raise UnfitMapError(f"the main arm of {foe_lane.line.length:.0f} m has no room for a convoy")
    return ConvoySetup(
        drivers=tuple(body for _ in places), places=places, lane=foe_lane.id,
        edges=(foe_lane.edge, network.lanes[chosen.foe.to_lane].edge),
        zone_m=foe_lane.line.length + chosen.zone.b_in, line_lane=ego_lane.id, ego_zone_m=chosen.zone.a_in,
        ego_cruise_mps=cruise, ego_turn_mps=turn,
    )  # fmt: skip
