"""Roundabout scenes: the ego enters a ring on which a convoy comes round, and leaves it on another arm.

Source: docs/scenes.md, "Roundabout". Units: m, m/s, s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.junction_priority import Conflict, meeting, turn_speed
from tsbench.make.placements.placement import (
    Arrangement,
    ConvoySetup,
    ScenePlacement,
    SceneTask,
    before_line,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
    way_from_standstill,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.traffic import Driver
from tsbench.roads.lane_graph import Destination, RoutePath
from tsbench.roads.network import Connection, Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.rule_kinds import RoundaboutParams
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

_STILL_ROOM_M = 0.5
_BEND_M = 5.0
_ROOM_M = 0.5
_FASTER_MPS = 0.5


class RoundaboutPlacement(ScenePlacement):
    """`roundabout`: 4.3 at the entry of the map; who is on the ring goes first."""

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The ring has priority, and no vehicle drives it faster than its bend allows."""
        ring = set(row.fields["ring"])
        radius = row.length_m / (2.0 * math.pi)
        bend = round(math.sqrt(recipe.number("ring_lateral_mps2") * radius), 2)
        high, low = int(recipe.number("ring_priority")), int(recipe.number("entry_priority"))
        edges = tuple(
            replace(e, priority=high, speed=min(e.speed, bend)) if e.id in ring else replace(e, priority=low)
            for e in plain.edges
        )
        return replace(plain, edges=edges)

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the line (or as far as its arm reaches), a convoy on the ring timed to meet it."""
        row, network, graph, recipe, variant = task.row, task.network, task.graph, task.recipe, task.variant
        ring, approach, leave = row.fields["ring"], row.fields["entry_edge"], row.fields["exit_edge"]
        node = network.edges[approach].target
        upstream = next((e for e in ring if network.edges[e].target == node), "")
        route = graph.route(approach, leave)
        require(
            bool(upstream) and route is not None and set(route[1:-1]) <= set(ring) and len(route) > 2,
            "the exit is not reached along the ring",
        )
        assert route is not None
        exit_lane = network.edge_lanes(leave)[0]
        round_m = sum(network.edges[e].length for e in route[1:-1])
        room = exit_lane.line.length - recipe.number("end_before_edge_m")
        least = recipe.number("least_exit_m")
        require(room >= least, f"the exit arm is {exit_lane.line.length:.0f} m long")
        end_s = variant.route_end(least, room)
        destination = Destination(leave, end_s)
        lane, path = _entry_lane(task, route, destination)
        before = min(recipe.number("ego_before_line_m"), lane.line.length - EGO_LENGTH_M - _STILL_ROOM_M)
        require(before >= recipe.number("ego_least_m"), f"the entry lane is {lane.line.length:.0f} m long")
        start = EgoStart(lane.id, before_line(lane, before), start_speed(task, lane))
        require(
            _sharpest(path) <= math.radians(recipe.number("sharpest_bend_deg")),
            "the way has a bend that no car can take",
        )
        met = _met(network, _taken(network, path, approach), upstream)
        require(bool(met), "no path on the ring meets the ego's and goes first")
        cars = ring_convoy(task, met, start, before)
        others = [leg["edges"][-1] for leg in row.fields["entries"] if leg["edges"][-1] != approach]
        params = RoundaboutParams(approach, node, (upstream,), ring=tuple(ring))
        before_m = recipe.number("plate_before_line_m")
        sign = plate_beside(network, self.code, approach, lane.line.length - before_m, params)
        # A ring is signed at every entry.
        lengths = {e: network.edge_lanes(e)[0].line.length for e in others if e in network.edges}
        more = [
            plate_beside(network, self.code, e, max(length - before_m, 0.0), number=k + 1, role=DISTRACTOR)
            for k, (e, length) in enumerate(lengths.items())
        ]
        return Arrangement(
            signs=(sign, *more),
            targets=(sign.id,),
            start=start,
            destination=destination,
            route_hint=route,
            route_length=round_m + end_s,
            convoy=cars,
            quiet_edges=frozenset(cars.edges[:-1]),
            platoons=frozenset(others),
            blocked=keep_clear(passenger_lanes(network, approach), start),
        )


def _entry_lane(task: SceneTask, route: tuple[str, ...], destination: Destination) -> tuple[Lane, RoutePath]:
    """A lane of the entry from which the way takes the fewest lane changes, and that way."""
    options: list[tuple[int, Lane, RoutePath]] = []
    for lane in passenger_lanes(task.network, route[0]):
        path = task.graph.path(route, lane.index, 0.0, destination)
        if path is not None:
            options.append((_changes(task.network, path, lane), lane, path))
    require(bool(options), "the way to the exit has no lanes that connect")
    least = min(changes for changes, _, _ in options)
    best = [(lane, path) for changes, lane, path in options if changes == least]
    return best[task.variant.layout % len(best)]


def _sharpest(path: RoutePath) -> float:
    """The greatest change of heading within 5 m of a way, rad."""
    line = path.line.slice(0.0, path.destination_s)
    heading = np.unwrap([line.heading_at(s) for s in np.arange(0.0, line.length, _BEND_M / 5)])
    return float(np.abs(heading[5:] - heading[:-5]).max())


def _changes(network: RoadNetwork, path: RoutePath, start: Lane) -> int:
    """Lane changes of a path: how often it goes on along another lane than the one that it came onto."""
    reached = {c.via[-1]: c.to_lane for c in network.connections if c.via}
    lane, changes = start.index, 0
    for piece in path.pieces:
        if network.lanes[piece.lane].internal:
            lane = reached.get(piece.lane, lane)
        else:
            changes += abs(network.lanes[piece.lane].order - network.lanes[lane].order)
            lane = piece.lane
    return changes


def _taken(network: RoadNetwork, path: RoutePath, approach: str) -> Connection:
    """The connection by which a path leaves its approach."""
    lanes = [p.lane for p in path.pieces]
    last = max(k for k, i in enumerate(lanes) if network.lanes[i].edge == approach)
    return next(c for c in network.outgoing[lanes[last]] if c.via and c.via[0] == lanes[last + 1])


def _met(network: RoadNetwork, ego: Connection, upstream: str) -> list[Conflict]:
    """Connections from the ring that stay on it, meet the ego's and have right of way over it in SUMO, too."""
    found = []
    target = network.lanes[ego.to_lane].edge
    for lane in passenger_lanes(network, upstream):
        for priority in network.outgoing[lane.index]:
            if network.lanes[priority.to_lane].edge != target or ego.yields_to.isdisjoint(priority.via):
                continue
            zone = meeting(network, ego, priority)
            if zone is not None and (ego.state, priority.state) == ("m", "M"):
                found.append(Conflict(ego, priority, zone))
    # Those who will share the ego's lane first: what is beside it only brushes its way.
    return sorted(found, key=lambda c: (c.priority.to_lane != ego.to_lane, c.priority.from_lane))


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
    # Faster where it has farther to go than it would come in that time.
    way, most = lead.back + chosen.zone.b_in, recipe.number("convoy_most_mps")
    while body.speed < most and way_from_standstill(body, time) < way:
        body = replace(body, speed=min(body.speed + _FASTER_MPS, most))
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
