"""Background traffic of a scene: drivers drawn from the nuPlan figures, SUMO vehicles, their routes and departures.

Cars stand on every lane at the asked spacing when the episode begins; later vehicles come from a dry run in SUMO
(`scene_files`). Source: docs/simulation.md, "Traffic". Units: m, s, m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass

import numpy as np

from tsbench.geometry.elementary import STRAIGHT
from tsbench.make.scenes.plate_roads import PlateRoads
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.nuplan import quantile_speed, statistics
from tsbench.sim.scene import EgoStart

DRIVERS_PER_DRAW = 12
# Bodies by nuPlan's size classes: length, width in m.
BODIES = {"s": (3.7, 1.65), "m": (4.5, 1.85), "l": (5.3, 2.0), "xl": (8.5, 2.4)}


@dataclass(frozen=True, slots=True)
class Driver:
    """One IDM driver: desired speed (m/s), a, b (m/s2), headway (s), standstill gap (m), body length and width (m)."""

    speed: float
    accel: float
    decel: float
    headway: float
    gap: float
    length: float
    width: float


def _lognormal(rng: np.random.Generator, median: float, mean: float, low: float, high: float) -> float:
    sigma = math.sqrt(2.0 * math.log(mean / median))
    return float(np.clip(median * math.exp(sigma * rng.standard_normal()), low, high))


def draw_driver(rng: np.random.Generator) -> Driver:
    """One driver.

    Free-flow speed: the upper three fifths of moving speeds, because the lower ones are cars held up by others.
    IDM's a and b are *largest* comfortable values: twice the published typical ones. The headway is what the published
    median gap is at the published median speed.
    """
    stats = statistics()
    acc, dec = stats["acceleration_mps2"], stats["deceleration_mps2"]
    following = stats["following_distance_m"]
    gap = float(rng.uniform(1.5, 3.0))
    headway = (float(following["p50"]) - gap) / float(stats["speed_mps"]["p50"])
    spread = float(following["mean"]) / float(following["p50"])
    sizes = stats["size_mix"]
    size = str(rng.choice(list(sizes), p=np.array(list(sizes.values())) / sum(sizes.values())))
    length, width = BODIES[size]
    return Driver(
        speed=quantile_speed(float(rng.uniform(0.4, 1.0))),
        accel=_lognormal(rng, 2 * float(acc["p50"]), 2 * float(acc["mean"]), 0.8, 2.8),
        decel=_lognormal(rng, 2 * float(dec["p50"]), 2 * float(dec["mean"]), 1.0, 3.5),
        headway=_lognormal(rng, headway, headway * spread, 0.8, 3.0),
        gap=gap,
        length=length,
        width=width,
    )


def draw_drivers(rng: np.random.Generator) -> tuple[Driver, ...]:
    return tuple(draw_driver(rng) for _ in range(DRIVERS_PER_DRAW))


CLEAR_BEHIND_M = 40.0
CLEAR_BESIDE_M = 12.0
CLEAR_AHEAD_M = 20.0
CLEAR_AHEAD_S = 3.0
_STRAIGHT_ON = 4.0
_MAX_EDGES = 40


@dataclass(frozen=True, slots=True)
class Car:
    """One background vehicle. `position` is the front's place (None: enters at the start of its first edge)."""

    id: str
    driver: int
    depart: float
    edges: tuple[str, ...]
    lane: int
    position: float | None


@dataclass(frozen=True)
class TrafficRequest:
    """What is asked: cars per lane-km, drivers to draw from, the ego's start, and where nobody is put or sent.

    avoid_turns: what the plates forbid. quiet_edges: edges kept free at the start (the convoy's).
    blocked: (lane id, from, to) stretches where no car stands at first. platoons: edges on which cars enter in
    platoons, as from signals upstream, so that who gives way finds a gap in time. closed_edges: where nobody stands or
    enters; that nobody turns into them either is a matter of `avoid_turns`. quiet_s: until then nobody enters anywhere.
    """

    cars_per_lane_km: float
    drivers: tuple[Driver, ...]
    start: EgoStart
    avoid_turns: AbstractSet[Turn]
    quiet_edges: AbstractSet[str]
    blocked: tuple[tuple[str, float, float], ...]
    platoons: AbstractSet[str]
    closed_edges: AbstractSet[str] = frozenset()
    quiet_s: float = 0.0

    def allows(self, lane: Lane, s: float) -> bool:
        """May a car stand here when the episode begins?"""
        return lane.edge not in self.quiet_edges and not any(
            lane.id == name and a <= s <= b for name, a, b in self.blocked
        )


class Router:
    """Random ways through a crop, straight on preferred, never by a forbidden turn."""

    def __init__(self, graph: LaneGraph, avoid: AbstractSet[Turn]) -> None:
        self.graph, self.avoid = graph, avoid

    def walk(self, edge: str, rng: np.random.Generator) -> tuple[str, ...]:
        """Edges from `edge` to where the crop ends; no edge twice."""
        route = [edge]
        while len(route) < _MAX_EDGES:
            options = [
                e for e in self.graph.successors(route[-1]) if (route[-1], e) not in self.avoid and e not in route
            ]
            if not options:
                break
            weight = np.array([_STRAIGHT_ON if self.graph.turn(route[-1], e) == STRAIGHT else 1.0 for e in options])
            route.append(options[int(rng.choice(len(options), p=weight / weight.sum()))])
        return tuple(route)


def avoidable(turns: AbstractSet[Turn], graph: LaneGraph, avoided: AbstractSet[Turn]) -> frozenset[Turn]:
    """Those of the turns that cars can leave alone beside the avoided ones: another way on is left."""
    found: set[Turn] = set()
    for turn in sorted(turns):
        ways = {(turn[0], e) for e in graph.successors(turn[0])} - avoided - found
        if ways - {turn}:
            found.add(turn)
    return frozenset(found)


@dataclass(frozen=True)
class Sent:
    """Where other traffic is not sent, and which roads it does not use."""

    avoid_turns: frozenset[Turn]
    closed_edges: frozenset[str]


def shut_roads(roads: PlateRoads, shut: Sequence[tuple[str, ...]], *, ego: AbstractSet[str], sent: Sent) -> Sent | None:
    """Other traffic that leaves some more roads alone; None where one of the ego's would have no way on.

    shut: each road as its edges in driving order. ego: edges of its ways. A road from which only ways onto the ego's
    are left is not used either: all its traffic would stand where the ego turns.
    """
    avoid, closed, rest = set(sent.avoid_turns), set(sent.closed_edges), list(shut)
    while rest:
        road = rest.pop()
        closed |= {*road}
        for before in roads.ways_to(road[0]):
            avoid.add((before, road[0]))
            left = {e for e in roads.graph.successors(before) if (before, e) not in avoid}
            if before in ego and not left:
                return None
            if before not in ego | closed and left <= ego:
                rest.append(roads.back(edge=before, s=0.0).edges[::-1])
    return Sent(frozenset(avoid), frozenset(closed))


def driving_lanes(network: RoadNetwork, closed: AbstractSet[str] = frozenset()) -> list[Lane]:
    """Ordinary lanes for cars but those of closed edges, in the order of the network."""
    return [
        lane for lane in network.lanes if not lane.internal and lane.permits("passenger") and lane.edge not in closed
    ]


def lane_km(network: RoadNetwork, closed: AbstractSet[str] = frozenset()) -> float:
    """Kilometres of ordinary lanes for cars but those of closed edges."""
    return sum(lane.line.length for lane in driving_lanes(network, closed)) / 1000.0


def _lane_on(graph: LaneGraph, lane: Lane, edges: tuple[str, ...]) -> bool:
    """Can a route be driven from this lane of its first edge without a lane change?"""
    if len(edges) == 1:
        return True
    return any(c.from_lane == lane.index for c in graph.connections(edges[0], edges[1]))


def _clear_of_ego(lane: Lane, s: float, start: EgoStart, network: RoadNetwork) -> bool:
    ego_lane = network.lane(start.lane)
    if lane.edge != ego_lane.edge:
        return True
    ahead = s - start.s
    if lane.id != ego_lane.id:
        return abs(ahead) > CLEAR_BESIDE_M
    return ahead < -CLEAR_BEHIND_M or ahead > max(CLEAR_AHEAD_M, CLEAR_AHEAD_S * start.speed)


def standing_cars(network: RoadNetwork, graph: LaneGraph, ask: TrafficRequest, rng: np.random.Generator) -> list[Car]:
    """The cars that are there when the episode begins, at the asked spacing on every lane."""
    router = Router(graph, ask.avoid_turns)
    spacing = 1000.0 / ask.cars_per_lane_km
    cars: list[Car] = []
    for lane in driving_lanes(network, ask.closed_edges):
        s = float(rng.uniform(0.0, spacing))
        while s < lane.line.length - 2.0:
            if s > 6.0 and ask.allows(lane, s) and _clear_of_ego(lane, s, ask.start, network):
                edges = router.walk(lane.edge, rng)
                cars.append(make_car(cars, rng, 0.0, edges, lane, s, ask, graph))
            s += max(spacing * float(rng.uniform(0.75, 1.25)), 9.0)
    return cars


def make_car(
    cars: list[Car],
    rng: np.random.Generator,
    depart: float,
    edges: tuple[str, ...],
    lane: Lane,
    position: float | None,
    ask: TrafficRequest,
    graph: LaneGraph,
) -> Car:
    """The next car of a scene: it keeps to a way that its lane leads to, because crops are short for lane changes."""
    if not _lane_on(graph, lane, edges):
        onward = [c for c in graph.network.outgoing[lane.index] if graph.network.lanes[c.to_lane].permits("passenger")]
        usable = [c for c in onward if (lane.edge, graph.network.lanes[c.to_lane].edge) not in ask.avoid_turns]
        if usable:
            target = graph.network.lanes[usable[int(rng.integers(len(usable)))].to_lane].edge
            edges = (lane.edge, *Router(graph, ask.avoid_turns).walk(target, rng))
    driver = int(rng.integers(len(ask.drivers)))
    return Car(f"bg_{len(cars):03d}", driver, depart, edges, lane.order, position)
