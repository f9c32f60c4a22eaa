"""Checks scenario rows: hashes, and whether each scene is what it says (docs/scenes.md, "Certificates", sane).

`lint_rows` says where plates stand wrong and how others drive past them: `tsbench scenarios lint`.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import shapely

from tsbench.core.errors import InputError
from tsbench.make.scenes.placed_plates import PlacedPlates, broken_plates, scene_vehicles
from tsbench.make.scenes.plate_places import refused
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.make.scenes.recipe import recipe_types
from tsbench.make.scenes.scene_lint import lint_limits, lint_scene
from tsbench.make.scenes.split import APART_M, extents, with_places
from tsbench.roads.lane_graph import LaneGraph
from tsbench.scenarios.certificates import Certificate, bases
from tsbench.scenarios.map_pool import read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.signs.annotations import DISTRACTOR, TARGET
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID


def verify_rows(
    specs: Sequence[ScenarioSpec], loader: SceneLoader, progress: Callable[[int], None]
) -> list[tuple[str, str]]:
    """(scenario id, problem) of every row that is not what it says; empty if all are sound."""
    known = set(recipe_types())
    problems: list[tuple[str, str]] = []
    for k, spec in enumerate(specs):
        if spec.scenario_type not in known:
            problems.append((spec.scenario_id, f"unknown scenario type {spec.scenario_type!r}"))
        else:
            try:
                scene, roads = loader.load(spec)
                scene.catalog.check_plates(
                    spec.sign_code, {s.id: s.code for s in scene.signs if s.role != DISTRACTOR}, "scene"
                )
                found = (*lint_scene(scene, roads.graph), *lint_limits(roads.network, roads.view))
                problems += [(spec.scenario_id, problem) for problem in found]
            except InputError as error:
                problems.append((spec.scenario_id, str(error)))
        progress(k + 1)
    return problems


def verify_certificates(
    specs: Sequence[ScenarioSpec], certificates: Iterable[Certificate], earlier: Container[str]
) -> list[tuple[str, str]]:
    """(scenario id, problem) of rows without a certificate, or with one that is about something else.

    Rows of splits of an `earlier` edition may have had other columns: what their certificates were about is not asked.
    """
    known = {c.scenario_id: c.basis for c in certificates}
    split = {spec.scenario_id: spec.split for spec in specs}
    problems = []
    for name, basis in bases(specs).items():
        if name not in known:
            problems.append((name, "has no certificate (tsbench scenarios build makes it)"))
        elif known[name] != basis and split[name] not in earlier:
            problem = "its certificate is of another row or SUMO (tsbench scenarios certify renews it)"
            problems.append((name, problem))
    return problems


# What differs between the halves of a pair; all else is the same.
_OF_A_HALF = frozenset(
    (
        "scenario_id", "scenario_type", "group", "sign_code", "sign_value", "half", "net", "net_sha256", "additional",
        "additional_sha256",
    )
)  # fmt: skip


def verify_pairs(specs: Sequence[ScenarioSpec], certificates: Iterable[Certificate]) -> list[tuple[str, str]]:
    """(pair id, problem) of pairs whose halves are not two neighbours of one draw, or that measure nothing.

    specs: whole tables, in their order.
    """
    known = {c.scenario_id: c for c in certificates}
    problems = []
    for name, rows in groupby((s for s in specs if s.pair_id), key=lambda s: s.pair_id):
        halves = list(rows)
        if [row.half for row in halves] != [SIGNED, CONTRAST]:
            problems.append((name, "is not one signed row and, next to it, one contrast row"))
            continue
        alike = [{k: repr(v) for k, v in asdict(row).items() if k not in _OF_A_HALF} for row in halves]
        problems += [(name, f"the halves differ in {k}") for k in alike[0] if alike[0][k] != alike[1][k]]
        for row in halves:
            certificate = known.get(row.scenario_id)
            if certificate is not None:
                proven = certificate.exclusive is not None
                reason = certificate.unpaired_because(row) if proven else "its halves were never compared"
                problems += [(row.scenario_id, reason)] if reason else []
    return problems


def verify_split(specs: Sequence[ScenarioSpec], pool: Path) -> list[tuple[str, str]]:
    """Maps that are not in the pool, stand in two splits, are of another place, or within 300 m of another split's.

    specs: whole tables.
    """
    rows = {r.map_id: r for r in read_pool(pool)}
    split = {s.map_id: s.split for s in specs}
    problems = [(m, "map is not in the pool") for m in sorted(set(split) - set(rows))]
    both = {s.map_id for s in specs if s.split != split[s.map_id]}
    problems += [(m, "map is in two splits") for m in sorted(both)]
    names = [m for m in sorted(split) if m in rows]
    boxes = extents([rows[m] for m in names])
    near = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=APART_M - 0.5)
    problems += [
        (names[a], f"is within {APART_M:.0f} m of {split[names[b]]} map {names[b]}")
        for a, b in near.T.tolist()
        if split[names[a]] > split[names[b]]
    ]
    for side in sorted(set(split.values())):
        own = [s for s in specs if s.split == side]
        place = {s.map_id: s.place for s in with_places(own, list(rows.values()))}
        wrong = {s.map_id for s in own if s.place not in ("", place[s.map_id])}
        problems += [(m, f"is of place {place[m]}") for m in sorted(wrong)]
    return problems


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
