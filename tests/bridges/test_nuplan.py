"""nuPlan's protocol: what a planner of that kind is told here is what stands on the map and on the road."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from learned_scenes import Recorder, with_signs
from planner_loop import load

from tsbench.bridges.nuplan import NuPlanPlanner, StateSE2, TimePoint, TrackedObjectType, states
from tsbench.bridges.nuplan.nuplan_map import NuPlanMap
from tsbench.bridges.nuplan.nuplan_planner import kit
from tsbench.bridges.nuplan.states import SemanticMapLayer
from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.base import Trajectory
from tsbench.planners.geometry import EGO
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.roads.planner_map import build_planner_map
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import CONTRAST

Layer = Enum("Layer", ["LANE", "LANE_CONNECTOR", "ROADBLOCK", "ROADBLOCK_CONNECTOR", "STOP_LINE"])


@dataclass
class State:
    rear_axle: StateSE2
    time_point: TimePoint


class Straight:
    """A planner in nuPlan's manner: straight on at its speed, for `count` states 0.5 s apart. Keeps what it is told."""

    count = 8

    def __init__(self) -> None:
        self.told: list[Any] = []
        self.asked: list[Any] = []

    def initialize(self, initialization: Any) -> None:
        self.told.append(initialization)

    def compute_planner_trajectory(self, current_input: Any) -> Any:
        self.asked.append(current_input)
        ego, _ = current_input.history.current_state
        rear, speed = ego.rear_axle, ego.dynamic_car_state.speed
        c, s = math.cos(rear.heading), math.sin(rear.heading)
        states = [
            State(
                StateSE2(rear.x + 0.5 * k * speed * c, rear.y + 0.5 * k * speed * s, rear.heading),
                TimePoint(ego.time_us + 500_000 * k),
            )
            for k in range(self.count)
        ]
        return type("Answer", (), {"get_sampled_trajectory": lambda _: states})()


class Adapted(NuPlanPlanner):
    make = staticmethod(Straight)


@pytest.fixture
def planner(drive: Recorder) -> Adapted:
    made = Adapted()
    made.reset(drive.context)
    return made


def inner(planner: NuPlanPlanner) -> Straight:
    assert isinstance(planner._planner, Straight)
    return planner._planner


def test_the_route_is_told_once_in_roadblocks_and_connectors(planner: Adapted, drive: Recorder) -> None:
    for o in drive.seen:
        planner.act(o)
    (told,) = inner(planner).told
    assert told.route_roadblock_ids == ["sc", "sc>cn", "cn"]
    path = drive.seen[0].route.path
    assert (told.mission_goal.x, told.mission_goal.y) == path.line.point_at(path.destination_s)
    blocks = [
        told.map_api.get_map_object(name, Layer.ROADBLOCK)
        or told.map_api.get_map_object(name, Layer.ROADBLOCK_CONNECTOR)
        for name in told.route_roadblock_ids
    ]
    for a, b in pairwise(blocks):
        assert b.id in [block.id for block in a.outgoing_edges]
        assert a.id in [block.id for block in b.incoming_edges]


def test_another_way_is_told_anew(planner: Adapted, drive: Recorder) -> None:
    o = drive.seen[0]
    planner.act(o)
    shorter = replace(o.route.path, edges=("cn",))
    planner.act(replace(o, route=replace(o.route, path=shorter)))
    # The rest of the same way is nothing new.
    assert len(inner(planner).told) == 1
    other = replace(o.route.path, edges=("sc", "ce"))
    planner.act(replace(o, route=replace(o.route, path=other)))
    assert [told.route_roadblock_ids for told in inner(planner).told][1:] == [["sc", "sc>ce", "ce"]]


def test_the_ego_its_history_and_plates(planner: Adapted, drive: Recorder) -> None:
    seen = [with_signs(o) for o in drive.seen]
    for o in seen:
        planner.act(o)
    asked, o = inner(planner).asked[-1], seen[-1]
    ego, _ = asked.history.current_state
    assert asked.history.size == min(len(seen), 21)
    assert [state.time_us for state in asked.history.ego_states][-2:] == [
        round(1e6 * other.time) for other in seen[-2:]
    ]
    assert (ego.center.x, ego.center.y) == (o.ego.x, o.ego.y)
    dx, dy = ego.center.x - ego.rear_axle.x, ego.center.y - ego.rear_axle.y
    assert math.hypot(dx, dy) == pytest.approx(EGO.wheelbase / 2)
    assert math.atan2(dy, dx) == pytest.approx(o.ego.heading)
    assert ego.dynamic_car_state.speed == o.ego.speed
    assert asked.traffic_signs == o.signs
    assert asked.iteration.time_s == pytest.approx(o.time)


def test_others_by_kind_with_velocities_of_the_world(planner: Adapted, drive: Recorder) -> None:
    o = drive.seen[-1]
    planner.act(o)
    tracked = inner(planner).asked[-1].history.current_state[1].tracked_objects
    kinds = [one.tracked_object_type for one in tracked]
    assert kinds.count(TrackedObjectType.VEHICLE) == 1
    assert kinds.count(TrackedObjectType.PEDESTRIAN) == 1
    assert kinds.count(TrackedObjectType.TRAFFIC_CONE) == len(o.obstacles)
    car = tracked.get_tracked_objects_of_type(TrackedObjectType.VEHICLE)[0]
    k = o.actors.ids.tolist().index(car.metadata.track_id)
    assert car.velocity.magnitude() == pytest.approx(o.actors.speed[k])
    assert math.atan2(car.velocity.y, car.velocity.x) == pytest.approx(o.actors.pose[k, 2])
    assert car.box.geometry.area == pytest.approx(o.actors.length[k] * o.actors.width[k])
    assert len(tracked.get_agents()) + len(tracked.get_static_objects()) == len(tracked)


def test_lanes_join_and_have_sides(drive: Recorder) -> None:
    roads = NuPlanMap(drive.context.network)
    lanes = [*roads._layer(Layer.LANE).values(), *roads._layer(Layer.LANE_CONNECTOR).values()]
    joints = 0
    for lane in lanes:
        end = lane.baseline_path.discrete_path[-1]
        for after in lane.outgoing_edges:
            start = after.baseline_path.discrete_path[0]
            assert math.hypot(start.x - end.x, start.y - end.y) < 0.5
            assert lane in after.incoming_edges
            joints += 1
        middle = lane.baseline_path.linestring.interpolate(0.5, normalized=True)
        assert lane.contains_point(middle)
        pose = lane.baseline_path.get_nearest_pose_from_position(middle)
        left = lane.left_boundary.linestring
        to_left = shapely.Point(pose.x - 0.5 * math.sin(pose.heading), pose.y + 0.5 * math.cos(pose.heading))
        assert left.distance(to_left) < left.distance(middle)
        assert roads.get_map_object(lane.get_roadblock_id(), Layer.ROADBLOCK) or roads.get_map_object(
            lane.get_roadblock_id(), Layer.ROADBLOCK_CONNECTOR
        )
    assert joints > 10


def test_questions_about_places(drive: Recorder) -> None:
    roads = NuPlanMap(drive.context.network)
    ego = drive.seen[0].ego
    assert roads.get_one_map_object(ego, SemanticMapLayer.LANE).id == "sc_0"
    assert roads.is_in_layer(ego, Layer.ROADBLOCK)
    near = roads.get_proximal_map_objects(ego, 5.0, [Layer.LANE, Layer.LANE_CONNECTOR])
    assert "sc_0" in [lane.id for lane in near[Layer.LANE]]
    assert near[Layer.LANE_CONNECTOR] == []
    assert roads.get_distance_to_nearest_map_object(ego, Layer.LANE) == ("sc_0", 0.0)
    assert roads.get_distance_to_nearest_map_object(ego, Layer.STOP_LINE) == (None, math.inf)
    with pytest.raises(InputError, match=r"map layer TRAM: not here; there are LANE"):
        roads.get_map_object("x", Enum("Own", ["TRAM"]).TRAM)


def test_every_layer_of_nuplans_is_there_and_junctions_know_their_connectors(drive: Recorder) -> None:
    roads = NuPlanMap(drive.context.network)
    layers = roads.get_available_map_objects()
    assert [layer.name for layer in layers][15:] == ["CARPARK_AREA", "PUDO", "ROADBLOCK", "ROADBLOCK_CONNECTOR"]
    near = roads.get_proximal_map_objects(drive.seen[0].ego, 1000.0, layers)
    assert near[SemanticMapLayer.CARPARK_AREA] == near[SemanticMapLayer.STOP_LINE] == []
    connector = roads.get_map_object("sc>cn", Layer.ROADBLOCK_CONNECTOR)
    crossroads = connector.intersection()
    assert crossroads in near[SemanticMapLayer.INTERSECTION]
    assert connector in crossroads.interior_edges
    assert roads.get_map_object("sc_0", Layer.LANE) in crossroads.incoming_edges
    turns = {b: roads.get_map_object(f"sc>{b}", Layer.ROADBLOCK_CONNECTOR) for b in ("cn", "ce", "cw")}
    assert {b: block.interior_edges[0].turn_type.name for b, block in turns.items()} == {
        "cn": "STRAIGHT",
        "ce": "RIGHT",
        "cw": "LEFT",
    }


def test_paths_have_a_pose_every_half_metre(drive: Recorder) -> None:
    lanes = NuPlanMap(drive.context.network).layers["LANE"].values()
    for path in [lane.baseline_path for lane in lanes]:
        at = np.array([pose.array for pose in path.discrete_path])
        steps = np.hypot(*np.diff(at, axis=0).T)
        assert steps.min() > 0.25
        assert steps.max() < 0.5 + 1e-9
        assert steps.sum() == pytest.approx(path.length, rel=1e-2)


def test_lanes_beside_each_other() -> None:
    network = build_planner_map(load("corridor")).map
    right, left = NuPlanMap(network).layers["ROADBLOCK"]["ab"].interior_edges[:2]
    assert right.index == left.index + 1
    assert left.is_left_of(right)
    assert right.is_right_of(left)
    assert right.is_adjacent_to(left)
    assert left.right_boundary.id == right.left_boundary.id != right.right_boundary.id
    middle = left.baseline_path.discrete_path[3]
    assert right.oriented_distance(middle) == pytest.approx((left.width + right.width) / 2)
    assert left.get_width_left_right(middle) == pytest.approx((left.width / 2, left.width / 2))
    assert right.get_width_left_right(middle) == (math.inf, math.inf)


def test_a_stand_in_says_what_has_the_name_that_it_lacks(drive: Recorder) -> None:
    class Alone(Adapted):
        kit = states

    planner = Alone()
    planner.reset(drive.context)
    planner.act(drive.seen[0])
    ego, _ = inner(planner).asked[0].history.current_state
    with pytest.raises(AttributeError, match=r"EgoState.waypoint: a stand-in has no such name; nuplan-devkit's"):
        _ = ego.waypoint


MINE = """
from test_nuplan import Straight

class Mine(Straight):
    def __init__(self, count=8, *, offsets=()):
        super().__init__()
        self.count = count

def make(): return Mine(3)
def nothing(): return 5
"""


@pytest.mark.parametrize(
    ("attribute", "name", "poses"), [("Mine", "Mine", 7), ("Mine(4, offsets=[-1.0])", "Mine", 3), ("make", "make", 2)]
)
def test_a_planner_by_its_name_with_arguments(
    attribute: str, name: str, poses: int, drive: Recorder, tmp_path: Path
) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    loaded = resolve(f"nuplan:{tmp_path}/mine.py:{attribute}")
    planner = loaded.factory()
    planner.reset(drive.context)
    answer = planner.act(drive.seen[0])
    assert isinstance(answer, Trajectory)
    assert (loaded.name, len(answer.poses)) == (name, poses)
    assert resolve(f"nuplan:{tmp_path}/mine.py:{attribute}-e").privileged


def test_what_is_wrong_with_one_is_said_before_it_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    with pytest.raises(InputError, match=r"write arguments as in Mine\(horizon=4.0"):
        resolve(f"nuplan:{tmp_path}/mine.py:Mine(1 + x)")
    with pytest.raises(InputError, match=r"int: a planner of nuPlan's has initialize and compute_planner_tra"):
        resolve(f"nuplan:{tmp_path}/mine.py:nothing").factory()
    (tmp_path / "theirs.py").write_text("import nuplan\n")
    specs = [f"nuplan:{tmp_path}/theirs.py:Theirs", "nuplan:nuplan:Theirs"]
    monkeypatch.setitem(sys.modules, "nuplan", None)
    for spec in specs:
        with pytest.raises(
            InputError, match=r"git clone https://github.com/motional/nuplan-devkit, and pip install --no-deps"
        ):
            resolve(spec)


def test_between_questions_the_last_trajectory_is_followed(drive: Recorder) -> None:
    class Slow(Adapted):
        every = 5

    planner = Slow()
    planner.reset(drive.context)
    answers = [planner.act(o) for o in drive.seen[:6]]
    assert len(inner(planner).asked) == 2
    first, later = answers[0], answers[3]
    assert later.times[0] == pytest.approx(first.times[0] - 0.3)
    assert np.array_equal(first.poses, later.poses)
    # The first pose is that of the centre half a second on.
    o = drive.seen[0]
    on = 0.5 * o.ego.speed
    assert first.poses[0, :2] == pytest.approx(
        [o.ego.x + on * math.cos(o.ego.heading), o.ego.y + on * math.sin(o.ego.heading)]
    )


def test_a_trajectory_without_future_is_named(drive: Recorder) -> None:
    class Now(Straight):
        count = 1

    class Short(Adapted):
        make = staticmethod(Now)

    planner = Short()
    planner.reset(drive.context)
    with pytest.raises(InputError, match=r"Now: no state of its trajectory is later than now"):
        planner.act(drive.seen[0])


def test_without_a_planner_it_says_what_to_write() -> None:
    with pytest.raises(InputError, match=r"make = staticmethod"):
        NuPlanPlanner()


class Follower(Straight):
    """At 5 m/s along the centrelines of the way that it was told, which it asks the map for as it drives."""

    def initialize(self, initialization: Any) -> None:
        self.map, self.way = initialization.map_api, set(initialization.route_roadblock_ids)

    def compute_planner_trajectory(self, current_input: Any) -> Any:
        ego, _ = current_input.history.current_state
        rear = ego.rear_axle
        points = [(rear.x, rear.y)]
        lane = self.on_the_way(
            one
            for layer in (SemanticMapLayer.LANE, SemanticMapLayer.LANE_CONNECTOR)
            for one in self.map.get_all_map_objects(rear, layer)
        )
        while lane is not None and len(points) < 60:
            line = [(pose.x, pose.y) for pose in lane.baseline_path.discrete_path]
            ahead = [p for p in line if math.hypot(p[0] - rear.x, p[1] - rear.y) > 3.0] if len(points) == 1 else line
            c, s = math.cos(rear.heading), math.sin(rear.heading)
            points += [p for p in ahead if len(points) > 1 or c * (p[0] - rear.x) + s * (p[1] - rear.y) > 0.0]
            lane = self.on_the_way(lane.outgoing_edges)
        if len(points) < 2:
            return super().compute_planner_trajectory(current_input)
        at = np.array(points)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(at, axis=0).T)))
        wanted = np.arange(self.count + 1) * 2.5
        xs, ys = (np.interp(wanted, along, at[:, k]) for k in (0, 1))
        headings = np.arctan2(np.diff(ys), np.diff(xs))
        states = [
            State(StateSE2(x, y, heading), TimePoint(ego.time_us + 500_000 * k))
            for k, (x, y, heading) in enumerate(zip(xs, ys, headings, strict=False))
        ]
        return type("Answer", (), {"get_sampled_trajectory": lambda _: states})()

    def on_the_way(self, lanes: Iterable[Any]) -> Any:
        return next((lane for lane in lanes if lane.get_roadblock_id() in self.way), None)


class AdaptedFollower(NuPlanPlanner):
    make = staticmethod(Follower)


KINDS = ("speed_limit", "no_turn_left", "yield", "crosswalk", "one_way_right")


def drive_scenes(planner: LoadedPlanner, kinds: Sequence[str]) -> list[str]:
    """Outcomes in the first dev scene of each type, without its plate. Fails at an error."""
    rows = [row for row in DataSet().table("dev") if row.half == CONTRAST]
    runner = EpisodeRunner(planner)
    driven = [runner.run(next(row for row in rows if row.pair_type == kind)) for kind in kinds]
    runner.close()
    assert not [result.error for result in driven if result.error]
    return [str(result.outcome) for result in driven]


def test_a_small_planner_of_the_protocol_drives_five_scenes() -> None:
    outcomes = drive_scenes(LoadedPlanner("mine", AdaptedFollower), KINDS)
    # It minds nobody, so it may hit somebody; it keeps to the road and comes on.
    assert "off_road" not in outcomes
    assert outcomes.count("arrived") >= 2, outcomes


IDM = "nuplan.planning.simulation.planner.idm_planner:IDMPlanner(10, 1.0, 1.5, 1.0, 3.0, 16, 0.5, 40)"
SIMPLE = "nuplan.planning.simulation.planner.simple_planner:SimplePlanner(10.0, 0.25, [0.0, 0.0])"
EXAMPLE = Path(__file__).parents[2] / "examples" / "pdm_closed.py"
BESIDE = "is no checkout on PYTHONPATH (docs/adapters.md)"


def test_nuplans_own_planners_drive() -> None:
    pytest.importorskip("nuplan", reason=f"nuplan-devkit {BESIDE}")
    assert set(drive_scenes(resolve(f"nuplan:{IDM}"), KINDS)) == {"arrived"}
    drive_scenes(resolve(f"nuplan:{SIMPLE}"), KINDS[:2])


def test_pdm_closed_by_its_authors_drives() -> None:
    pytest.importorskip("tuplan_garage", reason=f"tuplan_garage {BESIDE}")
    for spec in (f"{EXAMPLE}:PdmClosed", f"nuplan:{EXAMPLE}:closed"):
        assert drive_scenes(resolve(spec), KINDS[:1]) == ["arrived"]


def test_all_of_nuplans_abstract_map_is_there(drive: Recorder) -> None:
    pytest.importorskip("nuplan", reason=f"nuplan-devkit {BESIDE}")
    roads = NuPlanMap(drive.context.network, kit())
    objects: Any = importlib.import_module("nuplan.common.maps.abstract_map_objects")
    abstract: Any = importlib.import_module("nuplan.common.maps.abstract_map").AbstractMap
    block = roads.layers["ROADBLOCK"]["sc"]
    ours = {
        roads: abstract,
        block: objects.RoadBlockGraphEdgeMapObject,
        block.interior_edges[0]: objects.Lane,
        next(iter(roads.layers["LANE_CONNECTOR"].values())): objects.LaneConnector,
        next(iter(roads.layers["INTERSECTION"].values())): objects.Intersection,
        block.interior_edges[0].baseline_path: objects.PolylineMapObject,
    }
    for one, kind in ours.items():
        assert isinstance(one, kind)
        public = {name for name in dir(kind) if name[0] != "_"}
        assert public <= set(dir(one)), f"{kind.__name__}: {public - set(dir(one))}"
