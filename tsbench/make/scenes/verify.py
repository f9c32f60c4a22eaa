"""Checks scenario rows: hashes, and whether each scene is what it says (docs/scenes.md, "Certificates", sane).

`lint_scene`: of one loaded scene. `lint_rows` says where plates stand wrong and how others drive past them:
`tsbench scenarios lint`. Units: m, rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
import shapely

from tsbench.core.benchmark import places_of_split
from tsbench.core.errors import InputError
from tsbench.geometry.elementary import wrap
from tsbench.geometry.footprint import boxes_overlap
from tsbench.make.scenes.plate_checks import PLATE_SIDE_M, refused
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.make.scenes.plate_surroundings import PlacedPlates, broken_plates, scene_vehicles
from tsbench.make.scenes.recipe import recipe_types
from tsbench.make.scenes.split import APART_M, extents, with_places
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.scenarios.certificates import Certificate, bases
from tsbench.scenarios.map_pool import read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.signs.annotations import TARGET
from tsbench.sim.ego import start_motion
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID, read_additional
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

PLATE_TURN_RAD = math.radians(15.0)
BEND_STEP_M = 1.0
BEND_STEPS = 5
BEND_RAD = math.radians(110.0)
BROKEN, BROKEN_BY_EGO = "broken", "broken by ego"
# What differs between the halves of a pair; all else is the same.
_OF_A_HALF = frozenset(
    (
        "scenario_id", "scenario_type", "group", "sign_code", "sign_value", "half", "net", "net_sha256", "additional",
        "additional_sha256",
    )
)  # fmt: skip


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
                scene.check_codes(spec.sign_code, "scene")
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
    split = {s.map_id: places_of_split(s.split) for s in specs}
    problems = [(m, "map is not in the pool") for m in sorted(set(split) - set(rows))]
    both = {s.map_id for s in specs if places_of_split(s.split) != split[s.map_id]}
    problems += [(m, "map is in two splits") for m in sorted(both)]
    names = [m for m in sorted(split) if m in rows]
    boxes = extents([rows[m] for m in names])
    near = shapely.STRtree(boxes).query(boxes, predicate="dwithin", distance=APART_M - 0.5)
    problems += [
        (names[a], f"is within {APART_M:.0f} m of {split[names[b]]} map {names[b]}")
        for a, b in near.T.tolist()
        if split[names[a]] > split[names[b]]
    ]
    for side in sorted({s.split for s in specs}):
        own = [s for s in specs if s.split == side]
        place = {s.map_id: s.place for s in with_places(own, list(rows.values()))}
        wrong = {s.map_id for s in own if s.place not in ("", place[s.map_id])}
        problems += [(m, f"is of place {place[m]}") for m in sorted(wrong)]
    return problems


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
    return PlacedPlates(
        scene.catalog, plate_roads(graph, scene.catalog.distances), scene.signs, scene.obstacles, scene_vehicles(scene)
    )


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


def lint_scene(scene: Scene, graph: LaneGraph) -> Iterator[str]:
    """What is wrong with a loaded scene, in words."""
    network = scene.network
    start = network.lane(scene.start.lane)
    if not EGO_LENGTH_M / 2 <= scene.start.s <= start.line.length - EGO_LENGTH_M / 2:
        yield f"the ego starts {scene.start.s:.1f} m along a lane of {start.line.length:.1f} m"
    goal = network.edge_lanes(scene.destination.edge)[0].line.length
    if not 0.0 <= scene.destination.s <= goal:
        yield f"the destination is {scene.destination.s:.1f} m along an edge of {goal:.1f} m"
    shortest = graph.route(start.edge, scene.destination.edge)
    if shortest is None:
        yield "no way from start to destination"
    elif shortest != scene.route_hint:
        yield "navigation gives another way than the scene says"
    if scene.compliant_hint and _obedient_way(scene, graph) != scene.compliant_hint:
        yield "the obedient way is not the one that the scene says"
    yield from _lint_ways(scene, graph)
    yield from _lint_plates(scene)
    yield from _lint_obstacles(scene)
    yield from _lint_bodies(scene)


def lint_limits(network: RoadNetwork, view: PlannerMap) -> Iterator[str]:
    """Lanes whose limit on the planners' map is not the one by which they are judged, in words."""
    for lane, judged in zip(network.lanes, network.shown_limits, strict=True):
        at = view.places[lane.index].lane
        if at >= 0 and view.map.lanes[at].speed != judged:
            yield f"lane {lane.id} is judged by {judged:.2f} m/s, the map shows {view.map.lanes[at].speed:.2f}"


def _obedient_way(scene: Scene, graph: LaneGraph) -> tuple[str, ...] | None:
    """The shortest way by the turn that the scene's obedient way begins with, not through an edge signed ahead."""
    first, then = scene.compliant_hint[0], scene.compliant_hint[1:2]
    others = {(first, e) for e in graph.successors(first) if e not in then}
    signed = {sign.edge for sign in scene.target_signs} - {first}
    return graph.route(first, scene.destination.edge, others, signed)


def _lint_ways(scene: Scene, graph: LaneGraph) -> Iterator[str]:
    """Can the ways be driven? No bend may be tighter than the ego's own turning circle allows."""
    start = scene.network.lane(scene.start.lane)
    for name, edges in (("the way of navigation", scene.route_hint), ("the obedient way", scene.compliant_hint)):
        if not edges:
            continue
        path = graph.path(edges, start.index, scene.start.s, scene.destination)
        if path is None:
            yield f"{name} has no lanes that connect"
            continue
        if path.destination_s < BEND_STEP_M:
            yield f"{name} does not lead on to the destination"
            continue
        line = path.line.slice(0.0, path.destination_s).resampled(BEND_STEP_M)
        heading = np.unwrap([line.heading_at(s + 0.01) for s in np.arange(0.0, line.length, BEND_STEP_M)])
        turn = np.abs(heading[BEND_STEPS:] - heading[:-BEND_STEPS])
        if turn.size and turn.max() > BEND_RAD:
            yield f"{name} turns by {math.degrees(turn.max()):.0f} degrees within {BEND_STEPS * BEND_STEP_M:.0f} m"


def _lint_plates(scene: Scene) -> Iterator[str]:
    for sign in scene.signs:
        lane = scene.network.edge_lanes(sign.edge)[0 if sign.lane < 0 else sign.lane]
        s, _ = lane.line.project(sign.x, sign.y)
        if abs(s - sign.position_m) > 1.0:
            yield f"plate {sign.id} stands {s:.1f} m along its lane, not {sign.position_m:.1f} m"
        if abs(wrap(sign.heading - lane.line.heading_at(s))) > PLATE_TURN_RAD:
            yield f"plate {sign.id} does not face its lane"
        outer = scene.network.edge_lanes(sign.edge)[0]
        beside = scene.network.to_kerb * outer.line.project(sign.x, sign.y)[1] - outer.width / 2
        on_obstacle = any(math.hypot(o.x - sign.x, o.y - sign.y) <= o.length for o in scene.obstacles)
        if not on_obstacle and not PLATE_SIDE_M[0] <= beside <= PLATE_SIDE_M[1]:
            yield f"plate {sign.id} stands {beside:.1f} m {scene.network.kerb_side} of its road's edge"


def _lint_obstacles(scene: Scene) -> Iterator[str]:
    for o in scene.obstacles:
        lane = scene.network.lane(o.lane)
        s, d = lane.line.project(o.x, o.y)
        if abs(d) > 0.3 or not o.length / 2 <= s <= lane.line.length - o.length / 2:
            yield f"obstacle {o.id} does not stand on its lane"


def _lint_bodies(scene: Scene) -> Iterator[str]:
    """Nothing starts inside anything: ego, convoy, obstacles and cars that stand there at time 0."""
    ego = start_motion(scene)
    bodies = [("ego", ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M)]
    root = read_additional(scene.additional.path, scene.additional.content)
    sizes = {t.attrib["id"]: (float(t.attrib["length"]), float(t.attrib["width"])) for t in root.iterfind("vType")}
    for v in root.iterfind("vehicle"):
        if v.get("id") == "ego" or float(v.get("depart", "0")) > 0 or v.get("departPos") == "base":
            continue
        route = v.find("route")
        assert route is not None
        lane = scene.network.edge_lanes(str(route.attrib["edges"]).split()[0])[int(v.attrib["departLane"])]
        length, width = sizes[v.attrib["type"]]
        s = float(v.attrib["departPos"]) * lane.line.length / lane.length - length / 2
        x, y = lane.line.point_at(s)
        bodies.append((str(v.attrib["id"]), x, y, lane.line.heading_at(s), length, width))
    xy = np.array([b[1:3] for b in bodies])
    for i, a in enumerate(bodies):
        for j in np.nonzero(np.hypot(*(xy[i + 1 :] - xy[i]).T) < 12.0)[0]:
            b = bodies[i + 1 + int(j)]
            if boxes_overlap(*a[1:], *b[1:]):
                yield f"{a[0]} and {b[0]} start in the same place"
