"""Roundabout scenes: the ego enters a ring on which a convoy comes round, and leaves it on another arm.

Source: docs/scenes.md, "Roundabout". Units: m, m/s.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.junction_convoy import Conflict, meeting
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    before_line,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
)
from tsbench.make.placements.ring_convoy import ring_convoy
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import Destination, RoutePath
from tsbench.roads.network import Connection, Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.plate_params import RoundaboutParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

_STILL_ROOM_M = 0.5
_BEND_M = 5.0


class RoundaboutPlacement(ScenePlacement):
    """`roundabout`: 4.3 at the entry of the map; who is on the ring goes first."""

    def __init__(self, recipe: Recipe) -> None:
        self._code = recipe.type.codes[0]

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
        sign = plate_beside(network, self._code, approach, lane.line.length - before_m, params)
        # A ring is signed at every entry.
        lengths = {e: network.edge_lanes(e)[0].line.length for e in others if e in network.edges}
        more = [
            plate_beside(network, self._code, e, max(length - before_m, 0.0), number=k + 1, role=DISTRACTOR)
            for k, (e, length) in enumerate(lengths.items())
        ]
        return Arrangement(
            signs=(sign, *more),
            target=sign.id,
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
