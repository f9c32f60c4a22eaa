"""One map made ready for one type: its networks, and the scene files and rows of its ten variants, in both halves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

from tsbench.core.benchmark import VARIANTS_OF
from tsbench.core.errors import SimulationError
from tsbench.core.xmlfile import read_plain, sha256
from tsbench.make.maps.crop import plain_crop
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainNet
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.placements.by_name import placement_of
from tsbench.make.placements.distractors import distractors, with_same_plates
from tsbench.make.placements.placement import Arrangement, SceneTask, UnfitMapError, UnluckyDrawError
from tsbench.make.placements.two_signs import TwoSignsPlacement
from tsbench.make.scenes.plate_checks import refused
from tsbench.make.scenes.plate_surroundings import PlacedPlates, broken_plates
from tsbench.make.scenes.recipe import Recipe, Variant, variants_of
from tsbench.make.scenes.scene_files import OtherTraffic, SceneFileWriter
from tsbench.make.scenes.traffic import draw_drivers, lane_km
from tsbench.make.seeds import rng_of
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import read_network
from tsbench.scenarios.certificates import Certificate
from tsbench.scenarios.map_pool import PoolRow
from tsbench.scenarios.scene_loader import Roads
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.sim.scene import SceneFile
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

NET_NAMES = {SIGNED: "net.net.xml.gz", CONTRAST: "contrast.net.xml.gz"}
# Of each row of a pair the end of its id, the half whose network it is on, and its half. Files have the end's letters.
_PAIR = (("", SIGNED, SIGNED), ("-c", CONTRAST, CONTRAST))
# A square is two pairs (`square_of`). By the part whose plates decide the network: the first, the last.
_SQUARE = (
    (("", SIGNED, SIGNED), ("-c", CONTRAST, CONTRAST), ("b", SIGNED, SIGNED), ("b-c", CONTRAST, CONTRAST)),
    (("", SIGNED, SIGNED), ("-c", SIGNED, CONTRAST), ("b", CONTRAST, SIGNED), ("b-c", CONTRAST, CONTRAST)),
)

# How often a variant is drawn until an expert solves it, it tempts and the violating baseline breaks its rule; and the
# share of a map's variants that may not tempt.
ATTEMPTS = 4
UNTEMPTING_MOST = 0.1
LESS_TRAFFIC = (1.0, 0.85, 0.7, 0.5)


class Prover(Protocol):
    """What drives rows to prove them (certify.certifier). expert: the one that is tried first."""

    expert: str

    def prove(
        self, spec: ScenarioSpec, blind_baseline: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        """The certificate of a row. asked, realised: cars per lane-km."""

    def known(self, rows: Sequence[ScenarioSpec], blind_baseline: str) -> tuple[Certificate, ...]:
        """The certificates of rows that were proven before on the same scenes; () where one was not."""

    def compare(self, proven: Sequence[Certificate]) -> tuple[Certificate, ...]:
        """They with what is known of their pair, or square; their rows were the last that `prove` drove."""

    def breaks(self, planner: str, spec: ScenarioSpec) -> bool:
        """Does `planner` (as `tsbench run` names it) break the rule of the row's sign?"""


@dataclass(frozen=True)
class MapScenarios:
    """What building one map for one type gave: rows with certificates, or the reason why it is unfit.

    certificates: one per row, () without a prover. rejected: why draws of variants were not kept.
    """

    map_id: str
    rows: tuple[ScenarioSpec, ...]
    certificates: tuple[Certificate, ...]
    reason: str
    rejected: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Drawn:
    """One draw of a variant: its row, or its pair's two. asked, density: cars per lane-km, wanted and realised."""

    rows: tuple[ScenarioSpec, ...]
    asked: float
    density: float


class _Placed(NamedTuple):
    """The plates of a draw's rows, before there is traffic. files: writes a scene; placed: plates of all scenes."""

    pair: str
    corners: Sequence[tuple[str, str, str]]
    there: SceneTask
    found: tuple[Arrangement, ...]
    files: Callable[[str, str, Arrangement], SceneFileWriter]
    placed: Callable[[Iterable[Arrangement], OtherTraffic | None], list[PlacedPlates]]


class SiteBuilder:
    """Builds sites of one type below `root` (`scenarios/build/`); `sim` is the process's one simulation.

    prover: without one every first draw is kept.
    """

    def __init__(self, recipe: Recipe, root: Path, sim: Simulation, prover: Prover | None = None) -> None:
        self.recipe, self.root = recipe, root
        self.placement = placement_of(recipe)
        self.sim, self.prover = sim, prover
        self._rejected: list[str] = []
        self._type_of = {code: kind for kind in recipe.catalog.types for code in kind.codes}

    def build(self, row: PoolRow, source: SourceNetwork, split: str) -> MapScenarios:
        """All variants of a map, or the reason that it can't carry the type."""
        folder = self.root / "scenes" / self.recipe.type.id / row.map_id
        self._rejected = []
        try:
            crop = plain_crop(row, source)
            plain = self.placement.prepare(row, crop, self.recipe)
            roads = {SIGNED: _roads(plain, folder / NET_NAMES[SIGNED])}
            if self.recipe.paired:
                other = self.placement.prepare_contrast(row, crop, self.recipe)
                same = other == plain
                roads[CONTRAST] = roads[SIGNED] if same else _roads(other, folder / NET_NAMES[CONTRAST])
            built = self._variants(row, roads, folder, split)
        except (UnfitMapError, SimulationError) as error:
            return MapScenarios(row.map_id, (), (), " ".join(str(error).split()), tuple(self._rejected))
        rows = tuple(spec for drawn, _ in built for spec in drawn.rows)
        certificates = tuple(c for _, found in built for c in found)
        return MapScenarios(row.map_id, rows, certificates, "", tuple(self._rejected))

    def _variants(
        self, row: PoolRow, roads: dict[str, Roads], folder: Path, split: str
    ) -> list[tuple[_Drawn, tuple[Certificate, ...]]]:
        """All that the split has; gives up as soon as too few of them can be what the type promises."""
        built: list[tuple[_Drawn, tuple[Certificate, ...]]] = []
        untempting = 0
        variants = variants_of(self.recipe.type.id, row.map_id)[: VARIANTS_OF[split]]
        for variant in variants:
            self._check_places(row, roads, folder, variant)
        for variant in variants:
            built.append(self._proven(row, roads, folder, variant, split))
            untempting += any(not c.tempting for c in built[-1][1][:1])
            if untempting > UNTEMPTING_MOST * len(variants):
                raise UnfitMapError(f"{untempting} variants do not tempt {self.recipe.blind_baseline}")
        return built

    def _check_places(self, row: PoolRow, roads: dict[str, Roads], folder: Path, variant: Variant) -> None:
        """Raises UnfitMapError where no draw of a variant has a place for its plates, before any variant is driven."""
        rejected = []
        for attempt in range(ATTEMPTS):
            try:
                self._placed(row, roads, folder, variant, attempt)
            except UnluckyDrawError as error:
                rejected.append(str(error))
            else:
                return
        self._rejected += rejected
        raise UnfitMapError(f"variant {variant.number}, {ATTEMPTS} draws, at last: {rejected[-1]}")

    def _proven(
        self, row: PoolRow, roads: dict[str, Roads], folder: Path, variant: Variant, split: str
    ) -> tuple[_Drawn, tuple[Certificate, ...]]:
        """The first draw that tempts, shows a violation and that the first expert solves; else the first that some
        expert solves, if possible one that tempts.
        """
        spare: tuple[Certificate, ...] = ()
        reason = "no draw"
        for attempt in range(ATTEMPTS):
            try:
                drawn = self._draw(row, roads, folder, variant, split, attempt)
            except UnluckyDrawError as error:
                reason = str(error)
                self._rejected.append(reason)
                continue
            if self.prover is None:
                return drawn, ()
            found = self._prove(self.prover, drawn, attempt)
            reason = next(filter(None, map(_why_not, drawn.rows, found)), "")
            if reason:
                self._rejected.append(reason)
                continue
            violator = self.recipe.violating_baseline
            plain = all(c.expert == self.prover.expert for c in found)
            if plain and found[0].tempting and (not violator or self.prover.breaks(violator, drawn.rows[0])):
                return drawn, found
            if not spare or (found[0].tempting and not spare[0].tempting):
                spare = found
        if not spare:
            raise UnfitMapError(f"variant {variant.number}, {ATTEMPTS} draws, at last: {reason}")
        return self._draw(row, roads, folder, variant, split, spare[0].attempt), spare

    def _prove(self, prover: Prover, drawn: _Drawn, attempt: int) -> tuple[Certificate, ...]:
        """One certificate a row; each is looked at only where those before it are what they should be."""
        if known := prover.known(drawn.rows, self.recipe.blind_baseline):
            return tuple(
                replace(one, attempt=attempt, asked_density=drawn.asked, realised_density=drawn.density)
                for one in known
            )
        found: list[Certificate] = []
        for spec in drawn.rows:
            found.append(prover.prove(spec, self.recipe.blind_baseline, attempt, drawn.asked, drawn.density))
            if _why_not(spec, found[-1]):
                return tuple(found)
        return prover.compare(found)

    def _placed(self, row: PoolRow, roads: dict[str, Roads], folder: Path, variant: Variant, attempt: int) -> _Placed:
        recipe, kind = self.recipe, self.recipe.type
        pair = f"{kind.id}-{row.map_id}-v{variant.number}"
        draw = f"{pair}~{attempt}"
        drivers = draw_drivers(rng_of("drivers", kind.id, row.map_id, max(variant.drivers, 0)))

        corners: Sequence[tuple[str, str, str]] = _PAIR if recipe.paired else _PAIR[:1]
        if isinstance(self.placement, TwoSignsPlacement):
            corners = _SQUARE[self.placement.decides]

        def task(half: str) -> SceneTask:
            there = roads[half]
            rng = rng_of("arrange", draw)
            return SceneTask(row, there.network, there.graph, recipe, variant, drivers, rng)

        def files(end: str, half: str, a: Arrangement) -> SceneFileWriter:
            path = folder / f"v{variant.number}{end.replace('-', '')}.add.xml.gz"
            a = replace(a, drivers=a.drivers or drivers)
            return SceneFileWriter(self.sim, roads[half], path, a, draw, recipe.catalog)

        def placed(found: Iterable[Arrangement], others: OtherTraffic | None) -> list[PlacedPlates]:
            pairs = zip(corners, found, strict=True)
            return [files(end, half, a).placed_plates(others) for (end, half, _), a in pairs]

        tasks = [task(network) for _, network, _ in corners]
        there, found = tasks[0], self._arranged(tasks)
        if len(found) == len(_PAIR):
            signed, contrast = found
            found = with_same_plates(there, signed, contrast, placed(found, None))
        return _Placed(pair, corners, there, found, files, placed)

    def _draw(
        self, row: PoolRow, roads: dict[str, Roads], folder: Path, variant: Variant, split: str, attempt: int
    ) -> _Drawn:
        pair, corners, there, found, files, placed = self._placed(row, roads, folder, variant, attempt)
        if not lane_km(there.network, found[0].closed_edges):
            variant = replace(variant, density=0.0)
        variant, others = self._traffic(variant, files(*corners[0][:2], found[0]))
        # Plates that need not be there are drawn last: no vehicle of any row may break one.
        scenes = placed(found, others)
        for scene in scenes:
            wrong = [(plate, why) for plate in scene.plates for _, why in refused(scene, plate)]
            wrong += [
                (plate, f"is broken: {v.id} {why}") for v in scene.vehicles for plate, why in broken_plates(scene, v)
            ]
            for plate, why in wrong:
                raise UnluckyDrawError(f"plate {plate.code} {why}")
        more = distractors(there, found[0], scenes)
        rows = []
        for (end, network, half), a in zip(corners, found, strict=True):
            writer = files(end, network, replace(a, signs=(*a.signs, *more)))
            writer.write(others)
            spec = replace(self._row(row, variant, split, writer), half=half, scenario_id=f"{pair}{end}")
            if self.recipe.paired:
                spec = replace(spec, pair_id=pair + end.removesuffix("-c"))
            rows.append(spec)
        return _Drawn(tuple(rows), variant.cars_per_lane_km, others.density)

    def _arranged(self, tasks: Sequence[SceneTask]) -> tuple[Arrangement, ...]:
        """The rows of a variant, from the task of each, in the order of its corners. Raises UnfitMapError."""
        signed = self.placement.place(tasks[0])
        if len(tasks) == 1:
            return (signed,)
        contrast = self.placement.contrast(tasks[len(tasks) // 2], signed)
        if contrast is None:
            raise UnfitMapError("there is no contrast half")
        if not isinstance(self.placement, TwoSignsPlacement):
            return signed, contrast
        first, both = (self.placement.first_contrast(tasks[k], a) for k, a in ((1, signed), (3, contrast)))
        return signed, first, contrast, both

    def _traffic(self, variant: Variant, writer: SceneFileWriter) -> tuple[Variant, OtherTraffic]:
        """The traffic of a scene, and its variant with the density that was asked in the end.

        Not every crop carries many cars: such a one gets fewer, down to half.
        """
        refused = ""
        for share in LESS_TRAFFIC:
            fewer = replace(variant, density=round(variant.density * share, 2))
            try:
                return fewer, writer.measure(fewer.cars_per_lane_km, self.recipe.horizon * DT_S)
            except UnluckyDrawError as error:
                refused = refused or str(error)
        raise UnluckyDrawError(refused)

    def _row(self, row: PoolRow, variant: Variant, split: str, files: SceneFileWriter) -> ScenarioSpec:
        a, net = files.a, files.roads.file
        target = next(s for s in a.signs if s.id == a.targets[0])
        kind = self.recipe.type if self.recipe.last else self._type_of[target.code]
        return ScenarioSpec(
            scenario_id=f"{self.recipe.type.id}-{row.map_id}-v{variant.number}", scenario_type=kind.id,
            group=kind.group, sign_code=target.code, sign_value=target.value, map_id=row.map_id, family=row.family,
            shape=row.shape, slot=row.slot, variant=variant.number, split=split, seed=files.seed,
            initial_speed=a.start.speed, route_length=a.route_length, density=variant.density,
            drivers=variant.drivers, layout=variant.layout, horizon=self.recipe.horizon,
            net=net.path.relative_to(self.root).as_posix(),
            additional=files.path.relative_to(self.root).as_posix(), net_sha256=sha256(net.content),
            additional_sha256=files.sha256,
        )  # fmt: skip


def _roads(plain: PlainNet, path: Path) -> Roads:
    build_net(plain, path)
    file = SceneFile(path, read_plain(path, "network"))
    network = read_network(path, file.content)
    return Roads(network, LaneGraph(network), LaneLocator(network), file)


def _why_not(spec: ScenarioSpec, certificate: Certificate) -> str:
    """Why a proven row is not kept, "" where it is."""
    if certificate.solvable and certificate.sane:
        return certificate.unpaired_because(spec)
    if certificate.error:
        return certificate.error
    if not certificate.solvable:
        return "no expert solves it"
    if certificate.overlaps:
        return "vehicles run into each other"
    return f"traffic of {certificate.asked_density:.1f} cars per lane-km is not there"
