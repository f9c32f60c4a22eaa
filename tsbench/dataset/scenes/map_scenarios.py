"""One map made ready for one type: its network, and the scene files and rows of its ten variants."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lxml import etree

from tsbench.core.errors import SimulationError
from tsbench.core.seeds import rng_of, seed_of
from tsbench.core.xmlfile import read_plain, sha256
from tsbench.dataset.maps.build import build_net
from tsbench.dataset.maps.crop import plain_crop
from tsbench.dataset.maps.source import SourceNetwork
from tsbench.dataset.placements.base import Arrangement, ConvoySetup, SceneTask, UnfitMapError
from tsbench.dataset.placements.registry import placement_of
from tsbench.dataset.scenes.demand_calibration import DemandCalibration
from tsbench.dataset.scenes.drivers import Driver, draw_drivers
from tsbench.dataset.scenes.dry_run import lead_time
from tsbench.dataset.scenes.elements import (
    background,
    convoy_elements,
    driver_types,
    ego_elements,
    obstacle_elements,
    write_additional,
)  # fmt: skip
from tsbench.dataset.scenes.lint import lint_scene
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.dataset.scenes.traffic import Car, TrafficRequest, lane_km, standing_cars
from tsbench.dataset.scenes.variants import Variant, variants_of
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import read_network
from tsbench.scenarios.certificates import DENSITY_TOLERANCE, Certificate
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.scene_loader import Roads
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import start_motion
from tsbench.sim.scene import ConvoyPlan, SceneFile, SceneLayout
from tsbench.sim.scene_file import layout_elements, read_layout, scene_from_layout
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

NET_NAME = "net.net.xml.gz"
DENSITY_GOAL = 0.1
REHEARSALS = 4


# How often a variant is drawn until an expert solves it, it tempts and its breaker is seen; how many of ten may not
# tempt.
ATTEMPTS = 4
UNTEMPTING_MOST = 1


class UnluckyDrawError(UnfitMapError):
    """This draw of a variant came to nothing; another one may."""


class Certifier(Protocol):
    """Who drives a row to prove it (certify.prover)."""

    def prove(
        self, spec: ScenarioSpec, tempted: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        """The certificate of a row. asked, realised: cars per lane-km."""

    def breaks(self, planner: str, spec: ScenarioSpec) -> bool:
        """Does `planner` (as `tsbench run` names it) break the rule of the row's sign?"""


@dataclass(frozen=True)
class MapScenarios:
    """What building one map for one type gave: rows with certificates, or the reason why it is unfit.

    certificates: one per row, () where nobody proved them.
    """

    map_id: str
    rows: tuple[ScenarioSpec, ...]
    certificates: tuple[Certificate, ...]
    reason: str


class SiteBuilder:
    """Builds sites of one type below `root` (`scenarios/build/`); `sim` is the process's one simulation.

    prover: without one every first draw is kept.
    """

    def __init__(self, recipe: Recipe, root: Path, sim: Simulation, prover: Certifier | None = None) -> None:
        self.recipe, self.root = recipe, root
        self.placement = placement_of(recipe)
        self.sim, self.prover = sim, prover

    def build(self, row: PoolRow, source: SourceNetwork, split: str) -> MapScenarios:
        """All variants of a map, or the reason that it can't carry the type."""
        folder = self.root / "scenes" / self.recipe.type.id / row.map_id
        try:
            plain = self.placement.prepare(row, plain_crop(row, source), self.recipe)
            net = folder / NET_NAME
            build_net(plain, net)
            file = SceneFile(net, read_plain(net, "network"))
            network = read_network(net, file.content)
            roads = Roads(network, LaneGraph(network), LaneLocator(network), file)
            built = self._variants(row, roads, folder, split)
        except (UnfitMapError, SimulationError) as error:
            return MapScenarios(row.map_id, (), (), " ".join(str(error).split()))
        rows, certificates = tuple(b[0] for b in built), tuple(b[1] for b in built if b[1] is not None)
        return MapScenarios(row.map_id, rows, certificates, "")

    def _variants(
        self, row: PoolRow, roads: Roads, folder: Path, split: str
    ) -> list[tuple[ScenarioSpec, Certificate | None]]:
        """All ten; gives up as soon as too few of them can be what the type promises."""
        built: list[tuple[ScenarioSpec, Certificate | None]] = []
        untempting = 0
        for variant in variants_of(self.recipe.type.id, row.map_id):
            built.append(self._proven(row, roads, folder, variant, split))
            certificate = built[-1][1]
            untempting += certificate is not None and not certificate.tempting
            if untempting > UNTEMPTING_MOST:
                raise UnfitMapError(f"{untempting} variants do not tempt {self.recipe.tempted}")
        return built

    def _proven(
        self, row: PoolRow, roads: Roads, folder: Path, variant: Variant, split: str
    ) -> tuple[ScenarioSpec, Certificate | None]:
        """The first draw that is solved, tempts and shows its breaker; else the first that lacks least."""
        spare: Certificate | None = None
        reason = "no draw"
        for attempt in range(ATTEMPTS):
            try:
                spec, density = self._variant(row, roads, folder, variant, split, attempt)
            except UnluckyDrawError as error:
                reason = str(error)
                continue
            if self.prover is None:
                return spec, None
            found = self.prover.prove(spec, self.recipe.tempted, attempt, variant.cars_per_lane_km, density)
            if found.solvable and found.sane:
                breaker = self.recipe.breaker
                if found.tempting and (not breaker or self.prover.breaks(breaker, spec)):
                    return spec, found
                if spare is None or (found.tempting and not spare.tempting):
                    spare = found
            else:
                reason = _why_not(found)
        if spare is None:
            raise UnfitMapError(f"variant {variant.number}, {ATTEMPTS} draws, at last: {reason}")
        return self._variant(row, roads, folder, variant, split, spare.attempt)[0], spare

    def _variant(
        self, row: PoolRow, roads: Roads, folder: Path, variant: Variant, split: str, attempt: int
    ) -> tuple[ScenarioSpec, float]:
        recipe, kind = self.recipe, self.recipe.type
        scenario_id = f"{kind.id}-{row.map_id}-v{variant.number}"
        draw = f"{scenario_id}~{attempt}"
        seed = seed_of("scenario", draw)
        drivers = draw_drivers(rng_of("drivers", kind.id, row.map_id, max(variant.drivers, 0)))
        a = self.placement.place(
            SceneTask(row, roads.network, roads.graph, recipe, variant, drivers, rng_of("arrange", draw))
        )
        files = _SceneFiles(self.sim, roads, folder, variant, a, a.drivers or drivers, seed, draw)
        density = files.write(recipe.horizon * DT_S)
        files.check_start()
        target = next(s for s in a.signs if s.id == a.target)
        relative = files.path.relative_to(self.root).as_posix()
        spec = ScenarioSpec(
            scenario_id=scenario_id, scenario_type=kind.id, group=kind.group, sign_code=target.code,
            sign_value=target.value, map_id=row.map_id, family=row.family, shape=row.shape, slot=row.slot,
            variant=variant.number, split=split, seed=seed, initial_speed=a.start.speed,
            route_length=a.route_length, density=variant.density, drivers=variant.drivers, layout=variant.layout,
            horizon=recipe.horizon, net=roads.file.path.relative_to(self.root).as_posix(), additional=relative,
            net_sha256=sha256(roads.file.content), additional_sha256=files.sha256,
        )  # fmt: skip
        return spec, density


def _why_not(certificate: Certificate) -> str:
    """Why a proven row is not kept."""
    if certificate.error:
        return certificate.error
    if not certificate.solvable:
        return "no expert solves it"
    if certificate.overlaps:
        return "vehicles run into each other"
    return f"traffic of {certificate.asked_density:.1f} cars per lane-km is not there"


class _SceneFiles:
    """Writes one variant's additional file, rehearsing what has to be measured."""

    def __init__(
        self, sim: Simulation, roads: Roads, folder: Path, variant: Variant, a: Arrangement,
        drivers: tuple[Driver, ...], seed: int, scenario_id: str,
    ) -> None:  # fmt: skip
        self.sim, self.roads, self.variant, self.a = sim, roads, variant, a
        self.drivers, self.seed, self.name = drivers, seed, scenario_id
        self.path = folder / f"v{variant.number}.add.xml.gz"
        self.trial = folder / f"v{variant.number}.trial.xml"
        self.sha256 = ""

    def write(self, duration_s: float) -> float:
        """Write the file; returns the realised density in cars per lane-km (0 without traffic)."""
        network, a = self.roads.network, self.a
        try:
            plan = self._convoy_plan() if a.convoy else None
            layout = SceneLayout(
                a.signs,
                a.target,
                a.obstacles,
                a.start,
                a.destination,
                plan,
                a.route_hint,
                a.compliant_hint,
                a.walkers,
            )
            fixed = layout_elements(layout, network)
            fixed += list(a.extra) + obstacle_elements(a.obstacles, network)
            cars, density = self._traffic(fixed, duration_s)
        finally:
            self.trial.unlink(missing_ok=True)
        moving = self._types() if cars else []
        moving += ego_elements(a.start, network, a.route_hint)
        if a.convoy:
            moving += self._convoy_elements(a.convoy)
        moving += background(cars)
        content = write_additional([*fixed, *moving], self.path)
        self.sha256 = sha256(content)
        return density

    def _types(self) -> list[etree._Element]:
        factors = self.a.speed_factors or [1.0] * len(self.drivers)
        return driver_types(self.drivers, factors)

    def _convoy_elements(self, c: ConvoySetup) -> list[etree._Element]:
        lanes = [self.roads.network.lane(name) for name in c.lanes or (c.lane,) * len(c.places)]
        stands = [
            (place, lane.order, c.edges[c.edges.index(lane.edge) :])
            for place, lane in zip(c.places, lanes, strict=True)
        ]
        return convoy_elements(c.drivers, stands, c.vclass)

    def _convoy_plan(self) -> ConvoyPlan:
        c = self.a.convoy
        assert c is not None
        write_additional(self._convoy_elements(c), self.trial)
        seconds = lead_time(
            self.sim, self.roads.file.path, self.trial, self.roads.network, self.seed, c.zone_m - c.places[0]
        )
        ids = tuple(f"convoy_{k}" for k in range(len(c.places)))
        return ConvoyPlan(c.line_lane, c.ego_zone_m, seconds, c.ego_cruise_mps, c.ego_turn_mps, ids)

    def _traffic(self, fixed: list[etree._Element], duration_s: float) -> tuple[list[Car], float]:
        asked = self.variant.cars_per_lane_km
        if not asked:
            return [], 0.0
        a, network, graph = self.a, self.roads.network, self.roads.graph
        ask = TrafficRequest(
            asked,
            self.drivers,
            a.start,
            a.avoid_turns,
            a.quiet_edges,
            a.blocked,
            a.platoons,
            a.closed_edges,
        )
        length = lane_km(network, a.closed_edges)
        goal = target = asked * length
        best: tuple[float, list[Car]] | None = None
        for rehearsal in range(REHEARSALS):
            rng = rng_of("traffic", self.name)
            standing = standing_cars(network, graph, ask, rng)
            if not rehearsal:
                write_additional([*fixed, *self._types(), *background(standing)], self.trial)
            self.sim.load(self.roads.file.path, self.trial, network, self.seed)
            inflow = DemandCalibration(self.sim, network, graph, ask, standing, target, rng)
            mean = inflow.drive(duration_s)
            if best is None or abs(mean - goal) < abs(best[0] - goal):
                best = (mean, inflow.cars)
            if abs(mean / goal - 1.0) <= DENSITY_GOAL:
                break
            target *= min(max(goal / max(mean, 0.1), 0.6), 1.8)
        assert best is not None
        # The departures written down happen as they were driven: no second run has to count them.
        got = best[0] / length
        if abs(got / asked - 1.0) > DENSITY_TOLERANCE:
            raise UnluckyDrawError(f"traffic of {asked:.1f} cars per lane-km becomes {got:.1f}")
        return best[1], got

    def check_start(self) -> None:
        """Read the scene back and load it as an episode does: it is sound, the ego is put in, the convoy is there."""
        a, network = self.a, self.roads.network
        lane = network.lane(a.start.lane)
        additional = SceneFile(self.path, read_plain(self.path, "scene file"))
        layout = read_layout(self.path, additional.content)
        scene = scene_from_layout(layout, network, self.roads.file, additional, 1, self.seed)
        for problem in lint_scene(scene, self.roads.graph):
            raise UnfitMapError(problem)
        self.sim.load_scene(scene)
        self.sim.start_ego(start_motion(scene), lane.edge, lane.order)
        present = {name for name, *_ in self.sim.fleet()}
        wanted = {f"convoy_{k}" for k in range(len(a.convoy.places))} if a.convoy else set()
        missing = sorted((wanted | {o.id for o in a.obstacles}) - present)
        if missing:
            raise SimulationError(f"{self.path}: SUMO did not insert {missing[0]}")
        if a.walkers:
            self.sim.hold_persons(a.walkers.persons)
