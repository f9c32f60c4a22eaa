"""Writes one half of a variant: its additional file, with what has to be measured for it."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from lxml import etree

from tsbench.core.errors import SimulationError
from tsbench.core.xmlfile import read_plain, sha256
from tsbench.make.placements.placement import Arrangement, ConvoySetup, UnfitMapError, UnluckyDrawError
from tsbench.make.scenes.demand_calibration import DemandCalibration
from tsbench.make.scenes.elements import (
    background,
    convoy_elements,
    driver_types,
    ego_elements,
    obstacle_elements,
    write_additional,
)
from tsbench.make.scenes.lint import lint_scene
from tsbench.make.scenes.placed_plates import PlacedPlates, routed_vehicles
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.make.scenes.traffic import Car, Sent, TrafficRequest, avoidable, lane_km, shut_roads, standing_cars
from tsbench.make.seeds import rng_of, seed_of
from tsbench.roads.lane_graph import Turn
from tsbench.roads.network import RoadNetwork
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
        return PlacedPlates(self.catalog, plate_roads(self.roads.graph), a.signs, a.obstacles, vehicles)

    def _elements(self, others: OtherTraffic) -> list[etree._Element]:
        a, network = self.a, self.roads.network
        moving = self._types() if others.cars else []
        moving += ego_elements(a.start, network, a.route_hint)
        if a.convoy:
            moving += self._convoy_elements(a.convoy)
        moving += background(others.cars)
        return [*self._fixed(others.convoy), *moving]

    def _fixed(self, plan: ConvoyPlan | None) -> list[etree._Element]:
        a, network = self.a, self.roads.network
        layout = SceneLayout(
            signs=a.signs, target=a.target, obstacles=a.obstacles, start=a.start, destination=a.destination,
            convoy=plan, route_hint=a.route_hint, compliant_hint=a.compliant_hint, walkers=a.walkers,
            contrast=a.contrast,
        )  # fmt: skip
        return layout_elements(layout, network) + list(a.extra) + obstacle_elements(a.obstacles, network)

    def _types(self) -> list[etree._Element]:
        return driver_types(self.a.drivers)

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
                write_additional([*fixed, *self._types(), *background(standing)], self.trial)
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
        roads, convoy = plate_roads(self.roads.graph), self.a.convoy
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


LEAD_LIMIT_S = 40.0
LEAD_ID = "convoy_0"


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
