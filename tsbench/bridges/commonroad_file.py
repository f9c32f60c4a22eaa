"""An episode as a CommonRoad scenario, XML of format 2020a, written with lxml alone.

CommonRoad's own library is not used to write: it insists on protobuf 3.20.2, which Ray and TensorBoard refuse. Its
reader opens the file in the tests. Source: the schema `XML_commonRoad_XSD.xsd` of commonroad-io. Units: m, s, rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from itertools import count
from pathlib import Path

import shapely
from lxml import etree
from lxml.builder import E

import tsbench
from tsbench.bridges.commonroad_lanelets import (
    Element,
    intersections,
    lane_ids,
    lanelets,
    number,
    pieces,
    point,
    points,
    traffic_sign,
)
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.core.parquet import open_table
from tsbench.episode.trace import Trace
from tsbench.metrics.tracks import Track, actor_tracks, ego_rows
from tsbench.report.drawing.canvas import ATTRIBUTION
from tsbench.report.drawing.scene_shapes import destination_place
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import POOL_SCHEMA
from tsbench.sim.scene import Obstacle, Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind

# CommonRoad's made-up country: signs carry its default numbers, which are modelled on the German ones.
COUNTRY = "ZAM"
_KINDS = {ActorKind.CAR: "car", ActorKind.BUS: "bus", ActorKind.BICYCLE: "bicycle", ActorKind.PEDESTRIAN: "pedestrian"}
_TAGS = {"junction": "intersection", "roundabout": "roundabout"}
_NO_GEO_NAME = -999


def write_commonroad(trace: Trace, scene: Scene, path: Path) -> None:
    """Road, plates, obstacles, every road user's track, the ego as the first of them, and the planning problem."""
    ids = count(max(lane_ids(scene.network).values()) + 1)
    sign_ids = {sign.id: next(ids) for sign in scene.signs}
    cut = pieces(scene, ids)
    roads = lanelets(scene, cut, sign_ids, ids)
    ego = Track(-1, "ego", ActorKind.CAR, EGO_LENGTH_M, EGO_WIDTH_M, 0, ego_rows(trace))
    day = datetime.now(UTC).date().isoformat()
    made = f"tsbench {tsbench.__version__}: {trace.planner} on {trace.spec.scenario_id}; {ATTRIBUTION}, ODbL 1.0"
    head = {
        "commonRoadVersion": "2020a",
        "benchmarkID": benchmark_id(trace),
        "date": day,
        "author": "tsbench",
        "affiliation": "",
        "source": made,
        "timeStepSize": str(DT_S),
    }
    root = E.commonRoad(
        *_location(trace, DataSet(scene.city).pool_path),
        *roads,
        *(traffic_sign(sign, sign_ids[sign.id]) for sign in scene.signs),
        *intersections(scene.network, cut, ids),
        *(_static(obstacle, next(ids)) for obstacle in scene.obstacles),
        *(_dynamic(track, next(ids)) for track in [ego, *actor_tracks(trace)]),
        _problem(trace, scene, next(ids)),
        **head,
    )
    etree.indent(root)
    with io_errors_as_input_errors(path), replacing(path) as part:
        etree.ElementTree(root).write(str(part), encoding="UTF-8", xml_declaration=True)


def benchmark_id(trace: Trace) -> str:
    """COUNTRY_Map-1_VARIANT_T-1: one map, one configuration per variant, trajectories."""
    name = "".join(part.capitalize() for part in (trace.spec.scenario_type + "_" + trace.spec.map_id).split("_"))
    letters = "".join(c for c in name if c.isalnum())
    return f"{COUNTRY}_{letters}-1_{trace.spec.variant + 1}_T-1"


@lru_cache(maxsize=1)
def _places(pool: Path) -> dict[str, tuple[float, float]]:
    table = open_table(pool, POOL_SCHEMA, "tsbench maps harvest makes it", ("map_id", "lat", "lon"))
    return {row["map_id"]: (row["lat"], row["lon"]) for row in table.to_pylist()}


def _location(trace: Trace, pool: Path) -> list[Element]:
    lat, lon = _places(pool).get(trace.spec.map_id, (0.0, 0.0))
    tags = ("simulated", "urban", *((_TAGS[trace.spec.family],) if trace.spec.family in _TAGS else ()))
    place = (E.geoNameId(str(_NO_GEO_NAME)), E.gpsLatitude(f"{lat:.7f}"), E.gpsLongitude(f"{lon:.7f}"))
    return [E.location(*place), E.scenarioTags(*(E(tag) for tag in tags))]


def _state(tag: str, tick: int, row: Sequence[float]) -> Element:
    x, y, heading, speed = row
    exact = {"orientation": number(math.remainder(heading, math.tau)), "time": str(tick), "velocity": number(speed)}
    return E(tag, E.position(point(x, y)), *(E(name, E.exact(text)) for name, text in exact.items()))


def _box(length: float, width: float) -> Element:
    return E.shape(E.rectangle(E.length(number(length)), E.width(number(width))))


def _static(obstacle: Obstacle, obstacle_id: int) -> Element:
    kind = E.type("constructionZone" if obstacle.shape == "cones" else "roadBoundary")
    state = _state("initialState", 0, (obstacle.x, obstacle.y, obstacle.heading, 0.0))
    return E.staticObstacle(kind, _box(obstacle.length, obstacle.width), state, id=str(obstacle_id))


def _dynamic(track: Track, obstacle_id: int) -> Element:
    first, *others = track.rows.tolist()
    element = E.dynamicObstacle(
        E.type(_KINDS[track.kind]),
        _box(track.length, track.width),
        _state("initialState", track.first, first),
        id=str(obstacle_id),
    )
    if others:
        states = (_state("state", tick, row) for tick, row in enumerate(others, start=track.first + 1))
        element.append(E.trajectory(*states))
    return element


def _problem(trace: Trace, scene: Scene, problem_id: int) -> Element:
    """The ego at its start, and the stretch of road in which it has arrived, within the horizon."""
    ego = trace.snapshots[0].ego
    state = _state("initialState", 0, (ego.x, ego.y, ego.heading, ego.speed))
    state.extend((E.yawRate(E.exact(number(ego.yaw_rate))), E.slipAngle(E.exact(number(0.0)))))
    time = E.time(E.intervalStart("0"), E.intervalEnd(str(scene.horizon)))
    rings = (polygon.normalize().exterior for polygon in shapely.get_parts(destination_place(scene)[0]))
    areas = (E.polygon(*points(shapely.get_coordinates(ring)[:-1])) for ring in rings)
    return E.planningProblem(state, E.goalState(time, E.position(*areas)), id=str(problem_id))
