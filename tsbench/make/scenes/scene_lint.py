"""Is a scene what it says? Source: docs/scenes.md, "Certificates" (sane). Units: m, rad."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tsbench.geometry.elementary import wrap
from tsbench.geometry.footprint import boxes_overlap
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.sim.ego import start_motion
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import read_additional
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

PLATE_SIDE_M = (0.3, 3.0)
PLATE_TURN_RAD = math.radians(15.0)
BEND_STEP_M = 1.0
BEND_STEPS = 5
BEND_RAD = math.radians(110.0)


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
    signed = {scene.target_sign.edge} - {first}
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
