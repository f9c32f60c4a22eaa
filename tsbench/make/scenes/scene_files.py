"""Writes one half of a variant: its additional file, with what has to be measured for it.

Departures that keep the asked density are found by driving the scene once without the ego. While SUMO runs, a car is
let in wherever there is room as soon as there are fewer cars than asked; what was let in is written down and becomes
the scene's departures. What is missing from the mean of the first 30 s (the ego's and the convoy's surroundings start
empty) is made up for within them. Units: s, m.
"""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lxml import etree

from tsbench.core.errors import SimulationError
from tsbench.core.xmlfile import read_plain, sha256
from tsbench.make.placements.placement import Arrangement, ConvoySetup, UnfitMapError, UnluckyDrawError
from tsbench.make.scenes.plate_roads import Sent, plate_roads, shut_roads
from tsbench.make.scenes.plate_surroundings import PlacedPlates, routed_vehicles
from tsbench.make.scenes.traffic import (
    Car,
    Router,
    TrafficRequest,
    avoidable,
    background,
    convoy_elements,
    driver_types,
    driving_lanes,
    ego_elements,
    lane_km,
    make_car,
    obstacle_elements,
    standing_cars,
    write_additional,
)
from tsbench.make.scenes.verify import lint_scene
from tsbench.make.seeds import rng_of, seed_of
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.scenarios.certificates import DENSITY_TOLERANCE
from tsbench.scenarios.scene_loader import Roads
from tsbench.signs.catalog import Catalog
from tsbench.sim.ego import start_motion
from tsbench.sim.scene import ConvoyPlan, Scene, SceneFile, SceneLayout
from tsbench.sim.scene_file import layout_elements, read_layout
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

DENSITY_GOAL = 0.1
REHEARSALS = 6
LEAD_LIMIT_S = 40.0
LEAD_ID = "convoy_0"
DENSITY_WINDOW_S = 30.0
MOST_EXCESS = 1.5
LEAST_EXCESS = 0.6
CORRECT_WITHIN_S = 8.0
CYCLE_S = 30.0
GREEN_S = 15.0
ENTER_AFTER_EGO_S = 4.0
LEAST_HEADWAY_S = 1.5
LEAST_ROOM_M = 11.0
SHORTEST_LANE_M = 15.0
EVERY_TICKS = 4
# A car that stands for longer, so near its line or within a junction, never gets its turn.
LONGEST_STAND_S = 30.0
AT_LINE_M = 10.0
STANDING_M = 0.5
OWN_PREFIX = "bg_"


@dataclass(frozen=True)
class OtherTraffic:
    """The others in a scene: the background cars, their number per lane-km, and the convoy's start.

    Measured in the signed half; the contrast half has the same.
    """

    cars: tuple[Car, ...]
    density: float
    convoy: ConvoyPlan | None


class SceneFileWriter:
    """One half of a variant, with its background drivers. name: of the draw, for what it draws."""

    def __init__(self, sim: Simulation, roads: Roads, path: Path, a: Arrangement, name: str, catalog: Catalog) -> None:
        self.sim, self.roads, self.path, self.a = sim, roads, path, a
        self.seed, self.name, self.catalog = seed_of("scenario", name), name, catalog
        self.trial = path.with_name(f"{path.name.partition('.')[0]}.trial.xml")
        self.sha256 = ""

    def measure(self, cars_per_lane_km: float, duration_s: float) -> OtherTraffic:
        """Rehearse the scene. Raises UnluckyDrawError where its traffic does not come about."""
        try:
            plan = self._convoy_plan() if self.a.convoy else None
            cars, density = self._traffic(self._fixed(plan), cars_per_lane_km, duration_s)
        finally:
            self.trial.unlink(missing_ok=True)
        return OtherTraffic(tuple(cars), density, plan)

    def write(self, others: OtherTraffic) -> None:
        """Write the file, and see that the scene in it is sound and can begin."""
        self.sha256 = sha256(write_additional(self._elements(others), self.path))
        self._check_start()

    def placed_plates(self, others: OtherTraffic | None) -> PlacedPlates:
        """What decides where further plates can stand: the scene as it would be written; None: before it has others."""
        a, network = self.a, self.roads.network
        root = etree.Element("additional")
        root.extend(self._elements(others or OtherTraffic((), 0.0, None)))
        vehicles = routed_vehicles(root=root, network=network, lawful=a.compliant_hint or a.route_hint)
        return PlacedPlates(
            self.catalog, plate_roads(self.roads.graph, self.catalog.distances), a.signs, a.obstacles, vehicles
        )

    def _elements(self, others: OtherTraffic) -> list[etree._Element]:
        a, network = self.a, self.roads.network
        moving = driver_types(a.drivers) if others.cars else []
        moving += ego_elements(a.start, network, a.route_hint)
        if a.convoy:
            moving += self._convoy_elements(a.convoy)
        moving += background(others.cars)
        return [*self._fixed(others.convoy), *moving]

    def _fixed(self, plan: ConvoyPlan | None) -> list[etree._Element]:
        a, network = self.a, self.roads.network
        layout = SceneLayout(
            signs=a.signs, targets=a.targets, obstacles=a.obstacles, start=a.start, destination=a.destination,
            convoy=plan, route_hint=a.route_hint, compliant_hint=a.compliant_hint, walkers=a.walkers,
            contrast=a.contrast,
        )  # fmt: skip
        return layout_elements(layout, network) + list(a.extra) + obstacle_elements(a.obstacles, network)

    def _convoy_elements(self, c: ConvoySetup) -> list[etree._Element]:
        lanes = [self.roads.network.lane(name) for name in c.lanes or (c.lane,) * len(c.places)]
        stands = [
            (place, lane.order, c.edges[c.edges.index(lane.edge) :])
            for place, lane in zip(c.places, lanes, strict=True)
        ]
        return convoy_elements(c.drivers, stands, c.vclass, c.abrupt, c.departs)

    def _convoy_plan(self) -> ConvoyPlan:
        c = self.a.convoy
        assert c is not None
        write_additional(self._convoy_elements(c), self.trial)
        seconds = lead_time(
            self.sim, self.roads.file.path, self.trial, self.roads.network, self.seed, c.zone_m - c.places[0]
        )
        ids = tuple(f"convoy_{k}" for k in range(len(c.places)))
        return ConvoyPlan(
            c.line_lane, c.ego_zone_m, seconds, c.ego_cruise_mps, c.ego_turn_mps, ids, c.after_s, c.keeps_back
        )

    def _traffic(self, fixed: list[etree._Element], asked: float, duration_s: float) -> tuple[list[Car], float]:
        a, network, graph = self.a, self.roads.network, self.roads.graph
        if not asked:
            return [], 0.0
        length = lane_km(network, a.closed_edges)
        ask = TrafficRequest(
            asked, self.a.drivers, a.start, a.avoid_turns, a.quiet_edges, a.blocked, platoons=a.platoons,
            closed_edges=a.closed_edges, quiet_s=a.quiet_s,
        )  # fmt: skip
        goal = target = asked * length
        best: tuple[float, list[Car]] | None = None
        written: TrafficRequest | None = None
        for _ in range(REHEARSALS):
            rng = rng_of("traffic", self.name)
            standing = standing_cars(network, graph, ask, rng)
            if ask is not written:
                written = ask
                write_additional([*fixed, *driver_types(a.drivers), *background(standing)], self.trial)
            load_files(self.sim, self.roads.file.path, self.trial, network, self.seed)
            inflow = DemandCalibration(self.sim, network, graph, ask, standing, target, rng)
            mean = inflow.drive(duration_s)
            if inflow.jammed:
                ask, best = self._without(ask, inflow.jammed), None
                continue
            if best is None or abs(mean - goal) < abs(best[0] - goal):
                best = (mean, inflow.cars)
            if abs(mean / goal - 1.0) <= DENSITY_GOAL:
                break
            target *= min(max(goal / max(mean, 0.1), 0.6), 1.8)
        if best is None:
            raise UnluckyDrawError("cars stand in vain at ever new places")
        # The departures written down happen as they were driven: no second run has to count them.
        got = best[0] / length
        if abs(got / asked - 1.0) > DENSITY_TOLERANCE:
            raise UnluckyDrawError(f"traffic of {asked:.1f} cars per lane-km becomes {got:.1f}")
        return best[1], got

    def _without(self, ask: TrafficRequest, jammed: AbstractSet[Turn]) -> TrafficRequest:
        """The same without turns for which cars wait in vain, or without the road where such a turn is the only one.

        Raises UnluckyDrawError where that road is the ego's or the convoy's.
        """
        others = avoidable(jammed, self.roads.graph, ask.avoid_turns)
        if others:
            return replace(ask, avoid_turns=ask.avoid_turns | others)
        edge, onto = min(jammed)
        roads, convoy = plate_roads(self.roads.graph, self.catalog.distances), self.a.convoy
        road = roads.back(edge=edge, s=0.0).edges[::-1]
        ego = {*self.a.route_hint, *self.a.compliant_hint}
        kept = ego.union(convoy.edges if convoy else ())
        sent = Sent(frozenset(ask.avoid_turns), frozenset(ask.closed_edges))
        fewer = shut_roads(roads, [road], ego=ego, sent=sent) if kept.isdisjoint(road) else None
        if fewer is None or not kept.isdisjoint(fewer.closed_edges - sent.closed_edges):
            raise UnluckyDrawError(f"cars stand before {onto} in vain")
        return replace(ask, avoid_turns=fewer.avoid_turns, closed_edges=fewer.closed_edges)

    def _check_start(self) -> None:
        """Read the scene back and load it as an episode does: it is sound, the ego is put in, the convoy is there."""
        a, network = self.a, self.roads.network
        lane = network.lane(a.start.lane)
        additional = SceneFile(self.path, read_plain(self.path, "scene file"))
        layout = read_layout(self.path, self.catalog, additional.content)
        scene = Scene(
            **vars(layout),
            catalog=self.catalog,
            net=self.roads.file,
            additional=additional,
            network=network,
            horizon=1,
            seed=self.seed,
        )
        for problem in lint_scene(scene, self.roads.graph):
            raise UnfitMapError(problem)
        self.sim.load_scene(scene)
        self.sim.start_ego(start_motion(scene), lane.edge, lane.order)
        present = {name for name, *_ in self.sim.fleet()}
        stands = range(len(a.convoy.places)) if a.convoy and not a.convoy.departs else ()
        wanted = {f"convoy_{k}" for k in stands}
        wanted |= {o.id for o in a.obstacles} | {str(e.get("id")) for e in a.extra if e.tag == "vehicle"}
        missing = sorted(wanted - present)
        if missing:
            raise SimulationError(f"{self.path}: SUMO did not insert {missing[0]}")
        if a.walkers:
            self.sim.hold_persons(a.walkers.persons)


def load_files(sim: Simulation, net: Path, additional: Path, network: RoadNetwork, seed: int) -> None:
    """As `Simulation.load`, also where a path has commas: SUMO takes them for the ends of names."""
    with _without_commas(net) as plain_net, _without_commas(additional) as plain_additional:
        sim.load(plain_net, plain_additional, network, seed)


@contextmanager
def _without_commas(path: Path) -> Iterator[Path]:
    """A path at which this process reads the same file for as long as this lasts."""
    if "," not in str(path):
        yield path
        return
    with path.open("rb") as file:
        yield Path(f"/proc/self/fd/{file.fileno()}")


def lead_time(sim: Simulation, net: Path, additional: Path, network: RoadNetwork, seed: int, way_m: float) -> float:
    """Seconds until the convoy's lead has its front `way_m` further on, from its standing start or its entry.

    Raises SimulationError if it does not get there within 40 s.
    """
    load_files(sim, net, additional, network, seed)
    sim.step()
    convoy = [name for name, *_ in sim.fleet()]
    for vehicle in convoy:
        sim.hold(vehicle)
    sim.step()
    while not sim.is_there(LEAD_ID) and sim.time() < LEAD_LIMIT_S:
        sim.step()
    began = sim.distance_driven(LEAD_ID)
    for vehicle in convoy:
        sim.release(vehicle)
    for tick in range(1, int(LEAD_LIMIT_S / DT_S)):
        sim.step()
        if sim.distance_driven(LEAD_ID) - began >= way_m:
            return tick * DT_S
    raise SimulationError(f"{additional}: the convoy's lead does not reach the conflict zone")


class DemandCalibration:
    """Lets cars into a running simulation; `cars` is what was let in, in order.

    jammed: turns that a car waited for in vain, first at its line.
    """

    def __init__(
        self,
        sim: Simulation,
        network: RoadNetwork,
        graph: LaneGraph,
        ask: TrafficRequest,
        present: list[Car],
        target: float,
        rng: np.random.Generator,
    ) -> None:
        self.sim, self.network, self.graph, self.ask, self.rng = sim, network, graph, ask, rng
        self.cars = list(present)
        self.first_new = len(present)
        self.target = target
        self.router = Router(graph, ask.avoid_turns)
        entered = {c.to_lane for c in network.connections}
        lanes = driving_lanes(network, ask.closed_edges)
        self.entries = [i for i in lanes if i.index not in entered and i.line.length >= SHORTEST_LANE_M]
        # The lane that has waited longest is next; the first order is drawn.
        order = rng.permutation(len(self.entries))
        self.last = {lane.id: -100.0 + float(order[k]) for k, lane in enumerate(self.entries)}
        self.jammed: set[Turn] = set()
        # By car: its last ordinary edge, the lane and the place where it was seen first, and when.
        self._stands: dict[str, tuple[str, str, float, float]] = {}
        self.phase = float(rng.uniform(0.0, CYCLE_S))
        self.ego_edge = network.lane(ask.start.lane).edge

    def drive(self, duration_s: float) -> float:
        """Run the loaded scene; returns the mean number of cars on ordinary lanes over 30 s, once some may enter."""
        total, samples = 0, 0
        window = int(DENSITY_WINDOW_S / DT_S / EVERY_TICKS)
        for tick in range(int(duration_s / DT_S)):
            self.sim.step()
            if tick % EVERY_TICKS or tick * DT_S < self.ask.quiet_s:
                continue
            count, rear = self._fleet_now(tick * DT_S)
            wanted = self.target
            if samples < window:
                total, samples = total + count, samples + 1
                missing = self.target * samples - total
                wanted += missing / max(window - samples, CORRECT_WITHIN_S / DT_S / EVERY_TICKS)
            wanted = min(max(wanted, LEAST_EXCESS * self.target), MOST_EXCESS * self.target)
            self._let_in(round(tick * DT_S, 1), count, wanted, rear)
        return total / max(samples, 1)

    def _fleet_now(self, now: float) -> tuple[int, dict[str, float]]:
        """Background cars on ordinary lanes, and how far the last one on each lane has come."""
        count = 0
        rear: dict[str, float] = {}
        for name, lane, place in self.sim.fleet():
            if name.startswith(OWN_PREFIX):
                count += lane[0] != ":"
                rear[lane] = min(rear.get(lane, place), place)
                self._watch(name, lane, place, now)
        return count, rear

    def _watch(self, name: str, lane: str, place: float, now: float) -> None:
        """Note the turn of a car that stands at its line, or in a junction, for too long."""
        edge, before, since, at = self._stands.get(name, ("", "", 0.0, -1.0))
        if lane != before or place - since > STANDING_M:
            edge = edge if lane[0] == ":" else self.network.lane(lane).edge
            self._stands[name] = (edge, lane, place, now)
        elif now - at > LONGEST_STAND_S:
            left = self.network.lane(lane).line.length - place
            route = next(car.edges for car in self.cars if car.id == name)
            if edge in route[:-1] and (lane[0] == ":" or left < AT_LINE_M):
                self.jammed.add((edge, route[route.index(edge) + 1]))

    def _let_in(self, now: float, count: int, wanted: float, rear: dict[str, float]) -> None:
        red = (now + self.phase) % CYCLE_S > GREEN_S
        for lane in sorted(self.entries, key=lambda i: (self.last[i.id], i.index)):
            # Half a car: the next one would bring the mean as far above what is wanted as it is below it now.
            if count + 0.5 > wanted:
                return
            if now - self.last[lane.id] < LEAST_HEADWAY_S or rear.get(lane.id, 1e9) < LEAST_ROOM_M:
                continue
            if lane.edge == self.ego_edge and now < ENTER_AFTER_EGO_S:
                continue
            if red and lane.edge in self.ask.platoons:
                continue
            self._enter(now, lane)
            count += 1

    def _enter(self, now: float, lane: Lane) -> None:
        edges = self.router.walk(lane.edge, self.rng)
        car = make_car(self.cars, self.rng, round(now + DT_S, 1), edges, lane, None, self.ask, self.graph)
        self.sim.add_car(car.id, f"bg{car.driver}", car.edges, car.lane)
        self.cars.append(car)
        # A little unevenness, or all entries would beat in time.
        self.last[lane.id] = now + float(self.rng.uniform(0.0, 1.5))
