"""An episode as a CommonRoad scenario, XML of format 2020a, written with lxml alone.

CommonRoad's own library is not used to write: it insists on protobuf 3.20.2, which Ray and TensorBoard refuse. Its
reader opens the file in the tests. Source: the schema `XML_commonRoad_XSD.xsd` of commonroad-io. Units: m, s, rad.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

import shapely
from lxml import etree

import tsbench
from tsbench.core.parquet import open_table
from tsbench.episode.trace import Trace
from tsbench.report.drawing.landmarks import destination_place
from tsbench.report.drawing.style import ATTRIBUTION
from tsbench.report.export.lanelets import add_lanelets, add_points, add_sign, add_text, lane_ids, number
from tsbench.report.export.tracks import Track, actor_tracks, ego_rows
from tsbench.report.video.outfile import whole_file
from tsbench.scenarios.map_pool import POOL_SCHEMA, pool_file
from tsbench.sim.scene import Obstacle, Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind

# CommonRoad's made-up country: signs carry its default numbers, which are modelled on the German ones.
COUNTRY = "ZAM"
_KINDS = {
    ActorKind.CAR: "car",
    ActorKind.BUS: "bus",
    ActorKind.BICYCLE: "bicycle",
    ActorKind.PEDESTRIAN: "pedestrian",
}
_TAGS = {"junction": "intersection", "roundabout": "roundabout"}
_NO_GEO_NAME = -999


def write_commonroad(trace: Trace, scene: Scene, path: Path) -> None:
    """Road, plates, obstacles, every road user's track, the ego as the first of them, and the planning problem."""
    root = etree.Element(
        "commonRoad", commonRoadVersion="2020a", benchmarkID=benchmark_id(trace),
        date=datetime.now(UTC).date().isoformat(), author="tsbench", affiliation="",
        source=f"tsbench {tsbench.__version__}: {trace.planner} on {trace.spec.scenario_id}; {ATTRIBUTION}, ODbL 1.0",
        timeStepSize=str(DT_S),
    )  # fmt: skip
    _add_location(root, trace)
    next_id = max(lane_ids(scene.network).values()) + 1
    sign_ids = {sign.id: next_id + k for k, sign in enumerate(scene.signs)}
    next_id = add_lanelets(root, scene, sign_ids, next_id + len(sign_ids))
    for sign in scene.signs:
        add_sign(root, sign, sign_ids[sign.id])
    for obstacle in scene.obstacles:
        _add_static(root, obstacle, next_id)
        next_id += 1
    ego = Track(-1, "ego", ActorKind.CAR, EGO_LENGTH_M, EGO_WIDTH_M, 0, ego_rows(trace))
    for track in [ego, *actor_tracks(trace)]:
        _add_dynamic(root, track, next_id)
        next_id += 1
    _add_problem(root, trace, scene, next_id)
    etree.indent(root)
    with whole_file(path) as part:
        etree.ElementTree(root).write(str(part), encoding="UTF-8", xml_declaration=True)


def benchmark_id(trace: Trace) -> str:
    """COUNTRY_Map-1_VARIANT_T-1: one map, one configuration per variant, trajectories."""
    name = "".join(
        part.capitalize() for part in (trace.spec.scenario_type + "_" + trace.spec.map_id).split("_")
    )
    letters = "".join(c for c in name if c.isalnum())
    return f"{COUNTRY}_{letters}-1_{trace.spec.variant + 1}_T-1"


@lru_cache(maxsize=1)
def _places() -> dict[str, tuple[float, float]]:
    """Latitude and longitude of the pool's maps."""
    table = open_table(pool_file(), POOL_SCHEMA, "tsbench maps harvest makes it", ("map_id", "lat", "lon"))
    return {row["map_id"]: (row["lat"], row["lon"]) for row in table.to_pylist()}


def _add_location(root: etree._Element, trace: Trace) -> None:
    location = etree.SubElement(root, "location")
    add_text(location, "geoNameId", str(_NO_GEO_NAME))
    lat, lon = _places().get(trace.spec.map_id, (0.0, 0.0))
    add_text(location, "gpsLatitude", f"{lat:.7f}")
    add_text(location, "gpsLongitude", f"{lon:.7f}")
    tags = etree.SubElement(root, "scenarioTags")
    etree.SubElement(tags, "simulated")
    etree.SubElement(tags, "urban")
    if trace.spec.family in _TAGS:
        etree.SubElement(tags, _TAGS[trace.spec.family])


def _add_exact(state: etree._Element, tag: str, text: str) -> None:
    add_text(etree.SubElement(state, tag), "exact", text)


def _add_state(
    parent: etree._Element, tag: str, tick: int, row: tuple[float, float, float, float]
) -> etree._Element:
    x, y, heading, speed = row
    state = etree.SubElement(parent, tag)
    point = etree.SubElement(etree.SubElement(state, "position"), "point")
    add_text(point, "x", number(x))
    add_text(point, "y", number(y))
    _add_exact(state, "orientation", number(math.remainder(heading, math.tau)))
    _add_exact(state, "time", str(tick))
    _add_exact(state, "velocity", number(speed))
    return state


def _add_box(parent: etree._Element, length: float, width: float) -> None:
    box = etree.SubElement(etree.SubElement(parent, "shape"), "rectangle")
    add_text(box, "length", number(length))
    add_text(box, "width", number(width))


def _add_static(root: etree._Element, obstacle: Obstacle, obstacle_id: int) -> None:
    element = etree.SubElement(root, "staticObstacle", id=str(obstacle_id))
    add_text(element, "type", "constructionZone" if obstacle.shape == "cones" else "roadBoundary")
    _add_box(element, obstacle.length, obstacle.width)
    _add_state(element, "initialState", 0, (obstacle.x, obstacle.y, obstacle.heading, 0.0))


def _add_dynamic(root: etree._Element, track: Track, obstacle_id: int) -> None:
    element = etree.SubElement(root, "dynamicObstacle", id=str(obstacle_id))
    add_text(element, "type", _KINDS[track.kind])
    _add_box(element, track.length, track.width)
    rows = [tuple(row) for row in track.rows.tolist()]
    _add_state(element, "initialState", track.first, rows[0])
    if len(rows) > 1:
        trajectory = etree.SubElement(element, "trajectory")
        for tick, row in enumerate(rows[1:], start=track.first + 1):
            _add_state(trajectory, "state", tick, row)


def _add_problem(root: etree._Element, trace: Trace, scene: Scene, problem_id: int) -> None:
    """The ego at its start, and the stretch of road in which it has arrived, within the horizon."""
    element = etree.SubElement(root, "planningProblem", id=str(problem_id))
    ego = trace.snapshots[0].ego
    state = _add_state(element, "initialState", 0, (ego.x, ego.y, ego.heading, ego.speed))
    _add_exact(state, "yawRate", number(ego.yaw_rate))
    _add_exact(state, "slipAngle", number(0.0))
    goal = etree.SubElement(element, "goalState")
    time = etree.SubElement(goal, "time")
    add_text(time, "intervalStart", "0")
    add_text(time, "intervalEnd", str(scene.horizon))
    position = etree.SubElement(goal, "position")
    for polygon in shapely.get_parts(destination_place(scene)[0]):
        add_points(
            etree.SubElement(position, "polygon"), shapely.get_coordinates(polygon.normalize().exterior)[:-1]
        )
