"""Where plates stand and how others drive past them, over rows: `tsbench scenarios lint`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tsbench.make.scenes.driven_plates import broken_plates
from tsbench.make.scenes.placed_plates import PlacedPlates, scene_vehicles
from tsbench.make.scenes.plate_places import refused
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.roads.lane_graph import LaneGraph
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import TARGET
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID

BROKEN, BROKEN_BY_EGO = "broken", "broken by ego"


@dataclass(frozen=True, slots=True)
class PlateFinding:
    """A plate that cannot stand where it stands, or that a vehicle's way breaks.

    kind: the kind of place that the plate needs, BROKEN or BROKEN_BY_EGO. why: the reason.
    """

    scenario_id: str
    plate: str
    code: str
    role: str
    kind: str
    why: str

    def __str__(self) -> str:
        return f"{self.plate} ({self.code}, {self.role}): {self.kind}: {self.why}"


def lint_places(scene: Scene, graph: LaneGraph, scenario_id: str = "") -> tuple[PlateFinding, ...]:
    """All findings of one scene: by plate, then by vehicle."""
    placed = placed_plates(scene, graph)
    found = [
        PlateFinding(scenario_id, plate.id, plate.code, plate.role, place, why)
        for plate in placed.plates
        for place, why in refused(placed, plate)
    ]
    for vehicle in placed.vehicles:
        kind = BROKEN_BY_EGO if vehicle.id == EGO_ID else BROKEN
        found += [
            PlateFinding(scenario_id, plate.id, plate.code, plate.role, kind, f"{vehicle.id} {why}")
            for plate, why in broken_plates(placed, vehicle)
        ]
    return tuple(found)


def placed_plates(scene: Scene, graph: LaneGraph) -> PlacedPlates:
    """What decides where a loaded scene's plates can stand."""
    return PlacedPlates(scene.catalog, plate_roads(graph), scene.signs, scene.obstacles, scene_vehicles(scene))


def lint_rows(
    specs: Sequence[ScenarioSpec], loader: SceneLoader, progress: Callable[[int], None]
) -> list[PlateFinding]:
    """The findings of all rows, in their order. Raises InputError for a scene that cannot be loaded."""
    found: list[PlateFinding] = []
    for k, spec in enumerate(specs):
        scene, roads = loader.load(spec)
        found += lint_places(scene, roads.graph, spec.scenario_id)
        progress(k + 1)
    return found


def finding_counts(findings: Sequence[PlateFinding]) -> list[tuple[str, str, int, int, int]]:
    """By kind and group of signs (3.18.1 -> 3.18), then of all places and of all vehicles: plates, targets, rows."""
    groups: dict[tuple[str, str], list[PlateFinding]] = {}
    for f in findings:
        driven = f.kind in (BROKEN, BROKEN_BY_EGO)
        for key in ((f.kind, ".".join(f.code.split(".")[:2])), ("~vehicles" if driven else "~places", "all")):
            groups.setdefault(key, []).append(f)
    return [(kind.lstrip("~"), signs, *_counted(groups[kind, signs])) for kind, signs in sorted(groups)]


def _counted(findings: Sequence[PlateFinding]) -> tuple[int, int, int]:
    """Plates, targets among them, rows."""
    plates = {(f.scenario_id, f.plate, f.role) for f in findings}
    return len(plates), sum(p[2] == TARGET for p in plates), len({f.scenario_id for f in findings})
