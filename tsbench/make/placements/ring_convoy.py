"""A convoy that comes round a ring and is at the entry when the ego is. Units: m, m/s, s.

Source: docs/scenes.md, "Roundabout".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from tsbench.make.placements.junction_convoy import Conflict, turn_speed
from tsbench.make.placements.lane_users import way_from_standstill
from tsbench.make.placements.placement import ConvoySetup, SceneTask, passenger_lanes, require
from tsbench.make.scenes.drivers import Driver
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart

_ROOM_M = 0.5
_FASTER_MPS = 0.5


@dataclass(frozen=True)
class _Stretch:
    """A lane upstream of the entry and how far its end is from the ego's junction."""

    lane: Lane
    to_junction: float


@dataclass(frozen=True)
class _Stand:
    """Where a car stands: lane, its front's place there, how far that is from the junction."""

    lane: Lane
    place: float
    back: float


def ring_convoy(task: SceneTask, met: Sequence[Conflict], start: EgoStart, to_line: float) -> ConvoySetup:
    """One to three cars on the ring, so far back that the lead needs a little less time than the ego.

    Where the ring has no room at least `arc_least_m` upstream, they wait on the next arm. Raises UnfitMapError.
    """
    network, recipe, rng = task.network, task.recipe, task.rng
    chosen = met[0]
    lane = network.lanes[chosen.ego.from_lane]
    turn, cruise = turn_speed(network, chosen.ego), network.shown_limits[lane.index]
    eta = predicted_arrival(to_line, to_line + chosen.zone.a_in, start.speed, cruise, turn)
    body = replace(
        task.drivers[0],
        speed=float(rng.uniform(recipe.number("convoy_least_mps"), recipe.number("convoy_most_mps"))),
        accel=recipe.number("convoy_accel_mps2"),
        decel=3.0,
        headway=1.2,
        gap=2.0,
        length=4.5,
        width=1.85,
    )
    time = recipe.number("convoy_time_share") * eta
    # The first metres of its path behind the line lie before the zone.
    wanted = min(way_from_standstill(body, time), recipe.number("convoy_farthest_m")) - chosen.zone.b_in
    count = int(rng.integers(1, int(recipe.number("convoy_most")) + 1))
    stands = _stands(task, chosen, body, wanted, count)
    lead = stands[0]
    body = _in_time(body, lead.back + chosen.zone.b_in, time, recipe.number("convoy_most_mps"))
    return ConvoySetup(
        drivers=(body,) * len(stands),
        places=tuple(s.place for s in stands),
        lane=lead.lane.id,
        edges=_way(task, chosen, stands[-1].lane.edge),
        zone_m=lead.place + lead.back + chosen.zone.b_in,
        line_lane=lane.id,
        ego_zone_m=chosen.zone.a_in,
        ego_cruise_mps=cruise,
        ego_turn_mps=turn,
        lanes=tuple(s.lane.id for s in stands),
    )


def _in_time(body: Driver, way: float, time: float, most: float) -> Driver:
    """The driver, faster (up to `most`) where it has farther to go than it would come in that time."""
    while body.speed < most and way_from_standstill(body, time) < way:
        body = replace(body, speed=min(body.speed + _FASTER_MPS, most))
    return body


def _stands(task: SceneTask, chosen: Conflict, body: Driver, wanted: float, count: int) -> list[_Stand]:
    """The lead's stand, as near to `wanted` as there is one, and those behind it as far as there is room."""
    network, recipe = task.network, task.recipe
    ring = tuple(task.row.fields["ring"])
    arc = list(_upstream(network, ring, chosen))
    least = recipe.number("arc_least_m") - chosen.zone.b_in
    step = body.length + recipe.number("convoy_gap_m")
    options = [s for stretch in arc for s in _on(stretch, body, wanted) if s.back >= least]
    if not options:
        # A small ring: they wait on the nearest arm upstream that has the room.
        arms = list(_arms(network, ring, chosen, arc))
        options = [s for stretch in arms for s in _on(stretch, body, 0.0)]
        require(bool(options), "neither the ring nor an arm upstream has room for a convoy")
        arc = [next(stretch for stretch in arms if stretch.lane is options[0].lane)]
        wanted = options[0].back
    lead = min(options, key=lambda s: abs(s.back - wanted))
    stands = [lead]
    while len(stands) < count:
        last = stands[-1].back + step
        behind = [s for stretch in arc for s in _on(stretch, body, last) if s.back >= last - 1e-6]
        if not behind:
            break
        stands.append(min(behind, key=lambda s: s.back))
    return stands


def _on(stretch: _Stretch, body: Driver, wanted: float) -> Iterator[_Stand]:
    """The place on a stretch that is nearest to `wanted` m before the junction, if the lane holds a car."""
    lane = stretch.lane
    first, last = body.length + _ROOM_M, lane.line.length - _ROOM_M
    if first <= last:
        place = min(max(lane.line.length - (wanted - stretch.to_junction), first), last)
        yield _Stand(lane, place, stretch.to_junction + lane.line.length - place)


def _upstream(network: RoadNetwork, ring: tuple[str, ...], chosen: Conflict) -> Iterator[_Stretch]:
    """The ring's lanes that lead to the conflict, from the ego's junction upstream, but for the one behind it."""
    lane, gone = network.lanes[chosen.priority.from_lane], 0.0
    after = network.lanes[chosen.priority.to_lane].edge
    while True:
        yield _Stretch(lane, gone)
        gone += lane.line.length
        before = [c for c in network.connections if c.to_lane == lane.index and c.via]
        back = [c for c in before if network.lanes[c.from_lane].edge in ring]
        if not back or network.lanes[back[0].from_lane].edge == after:
            return
        gone += sum(network.lanes[v].line.length for v in back[0].via)
        lane = network.lanes[back[0].from_lane]


def _arms(network: RoadNetwork, ring: tuple[str, ...], chosen: Conflict, arc: list[_Stretch]) -> Iterator[_Stretch]:
    """Entries of the arms upstream that lead onto the arc, the nearest first."""
    own = network.lanes[chosen.ego.from_lane].edge
    for stretch in arc:
        for c in network.connections:
            edge = network.lanes[c.from_lane].edge
            into = network.lanes[c.to_lane].edge == stretch.lane.edge
            if into and c.via and edge not in ring and edge != own:
                inner = sum(network.lanes[v].line.length for v in c.via)
                lane = network.lanes[c.from_lane]
                if lane in passenger_lanes(network, edge):
                    yield _Stretch(lane, stretch.to_junction + stretch.lane.line.length + inner)


def _way(task: SceneTask, chosen: Conflict, first: str) -> tuple[str, ...]:
    """The convoy's edges: to the ego's junction, past it, and out at an exit that its lane leads to (the layouts)."""
    network, graph, ring = task.network, task.graph, task.row.fields["ring"]
    priority, before, after = (
        chosen.priority,
        network.lanes[chosen.priority.from_lane].edge,
        network.lanes[chosen.priority.to_lane].edge,
    )
    to_junction = graph.route(first, before)
    require(to_junction is not None, "the convoy does not come to the ego's entry")
    assert to_junction is not None
    turned = ring.index(after)
    onward: list[tuple[str, ...]] = []
    for k in range(len(ring)):
        edge = ring[(turned + k) % len(ring)]
        if edge in to_junction:
            break
        stay = tuple(ring[(turned + j) % len(ring)] for j in range(k + 1))
        onward += [(*stay, out) for out in graph.successors(edge) if out not in ring]
    require(bool(onward), "the convoy finds no exit behind the ego's entry")
    straight = [way for way in onward if _keeps_lane(network, priority.to_lane, way)]
    ways = straight or onward
    return (*to_junction, *ways[task.variant.layout % len(ways)])


def _keeps_lane(network: RoadNetwork, lane: int, way: tuple[str, ...]) -> bool:
    """Does a lane lead along the whole way without a change to another?"""
    for edge in way[1:]:
        onward = [c.to_lane for c in network.outgoing[lane] if network.lanes[c.to_lane].edge == edge]
        if not onward:
            return False
        lane = onward[0]
    return True
