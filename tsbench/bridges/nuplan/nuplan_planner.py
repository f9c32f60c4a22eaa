"""Drives a planner that speaks nuPlan's `AbstractPlanner` protocol: initialize, compute_planner_trajectory.

Where nuplan-devkit is importable, the planner is given its classes, else stand-ins with their names. Its trajectory is
followed by the tracker that follows every `Trajectory`. Units: m, s, rad.
"""

from __future__ import annotations

import ast
import math
from collections import deque
from collections.abc import Callable
from functools import cache, partial
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any, ClassVar, cast

import numpy as np

from tsbench.bridges.nuplan import nuplan_map, states
from tsbench.bridges.nuplan.nuplan_map import NuPlanMap
from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.planners.base import PlannerContext, Trajectory
from tsbench.planners.geometry import EGO
from tsbench.planners.observation import Observation
from tsbench.planners.planner_spec import import_attribute
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.world import ActorKind, EgoState

_MAPS = "nuplan.common.maps"
# Where nuPlan has what `states` stands in for.
_OWN = {
    "nuplan.common.actor_state": (
        "agent car_footprint dynamic_car_state ego_state oriented_box scene_object state_representation static_object "
        "tracked_objects tracked_objects_types vehicle_parameters"
    ),
    _MAPS: "maps_datatypes",
    "nuplan.planning.simulation": (
        "history.simulation_history_buffer observation.observation_type planner.abstract_planner "
        "simulation_time_controller.simulation_iteration"
    ),
}
_ABSTRACT = {
    "abstract_map.AbstractMap": nuplan_map.NuPlanMap,
    "abstract_map_objects.PolygonMapObject": nuplan_map.NuPlanArea,
    "abstract_map_objects.PolylineMapObject": nuplan_map.NuPlanPolylineMapObject,
    "abstract_map_objects.Lane": nuplan_map.NuPlanLane,
    "abstract_map_objects.LaneConnector": nuplan_map.NuPlanLaneConnector,
    "abstract_map_objects.RoadBlockGraphEdgeMapObject": nuplan_map.NuPlanRoadBlock,
    "abstract_map_objects.Intersection": nuplan_map.NuPlanIntersection,
}
_KINDS = {
    ActorKind.CAR: "VEHICLE",
    ActorKind.BUS: "VEHICLE",
    ActorKind.BICYCLE: "BICYCLE",
    ActorKind.PEDESTRIAN: "PEDESTRIAN",
}
_THINGS = {"cones": "TRAFFIC_CONE"}
# No plan here depends on heights.
_HEIGHT_M = 1.5


@cache
def kit() -> Any:
    """What has nuPlan's classes by name. Raises InputError where nuplan-devkit is there and does not import."""
    if find_spec("nuplan") is None:
        return states
    for place, ours in _ABSTRACT.items():
        module, _, name = place.partition(".")
        abstract: Any = import_attribute(f"{_MAPS}.{module}", name, "nuplan-devkit")
        abstract.register(ours)
    own: dict[str, Any] = {}
    for package, modules in _OWN.items():
        for module in modules.split():
            own |= cast("dict[str, Any]", import_attribute(f"{package}.{module}", "__dict__", "nuplan-devkit"))
    names = [n for n, v in vars(states).items() if getattr(v, "__module__", "") == states.__name__]
    return SimpleNamespace(**{name: own[name] for name in names if name[0] != "_"})


def ego_state(kit: Any, ego: EgoState, time: Any) -> Any:
    """From tsbench's, whose pose is the centre's and whose speed is the rear axle's, along the heading."""
    half = EGO.wheelbase / 2
    vehicle = kit.VehicleParameters(
        width=EGO.width,
        front_length=EGO.length / 2 + half,
        rear_length=EGO.length / 2 - half,
        cog_position_from_rear_axle=half,
        wheel_base=EGO.wheelbase,
        vehicle_name="tsbench",
        vehicle_type="car",
        height=_HEIGHT_M,
    )
    moving = kit.DynamicCarState(
        rear_axle_to_center_dist=vehicle.rear_axle_to_center,
        rear_axle_velocity_2d=kit.StateVector2D(ego.speed, 0.0),
        rear_axle_acceleration_2d=kit.StateVector2D(ego.acceleration, 0.0),
        angular_velocity=ego.yaw_rate,
    )
    body = kit.CarFootprint.build_from_center(kit.StateSE2(ego.x, ego.y, ego.heading), vehicle)
    return kit.EgoState(body, moving, ego.steering, is_in_auto_mode=True, time_point=time)


def detections(kit: Any, o: Observation, time: Any) -> Any:
    """Road users in the order in which they came into sight, then fixed things."""

    def scene_object(kind: str, pose: tuple[float, ...], number: int) -> dict[str, Any]:
        x, y, heading, length, width = pose
        return {
            "tracked_object_type": kit.TrackedObjectType[kind],
            "oriented_box": kit.OrientedBox(kit.StateSE2(x, y, heading), length, width, _HEIGHT_M),
            "metadata": kit.SceneObjectMetadata(time.time_us, str(number), number, str(number), kind.lower()),
        }

    found = []
    rows = zip(o.actors.boxes, o.actors.speed.tolist(), o.actors.kind.tolist(), o.actors.ids.tolist(), strict=True)
    for pose, speed, kind, number in rows:
        velocity = kit.StateVector2D(speed * math.cos(pose[2]), speed * math.sin(pose[2]))
        found.append(kit.Agent(**scene_object(_KINDS[ActorKind(kind)], pose, number), velocity=velocity))
    for k, thing in enumerate(o.obstacles):
        pose = thing.x, thing.y, thing.heading, thing.length, thing.width
        found.append(kit.StaticObject(**scene_object(_THINGS.get(thing.shape, "BARRIER"), pose, -1 - k)))
    return kit.DetectionsTracks(kit.TrackedObjects(found))


_KEPT = 21
_SOON_S = 1e-3


class NuPlanPlanner:
    """Base of an adapter: name the planner in a class of your own and give that to `--planner` (docs/adapters.md).

    make: returns the planner, whose trajectories have `get_sampled_trajectory()`: states of rear_axle and time_point.
    every: ticks from one question to the next; between, its last trajectory is followed.
    kit: what has the classes that it is told in; the function `kit` finds it, as the class is made.
    """

    make: ClassVar[Callable[[], Any]]
    every: ClassVar[int] = 1
    kit: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        cls.kit = getattr(cls, "kit", None) or kit()

    def __init__(self) -> None:
        if not hasattr(type(self), "make"):
            raise InputError(f"{type(self).__name__}: say which planner: make = staticmethod(MyPlanner)")
        self._planner = type(self).make()
        missing = [n for n in ("initialize", "compute_planner_trajectory") if not hasattr(self._planner, n)]
        if missing:
            raise InputError(f"{self._name()}: a planner of nuPlan's has {' and '.join(missing)}")
        self._map: NuPlanMap
        self._context: PlannerContext
        self._path: RoutePath | None = None
        self._route: list[str] = []
        self._asked = 0
        self._states: deque[tuple[Any, Any]] = deque(maxlen=_KEPT)
        self._times: Array
        self._poses: Array

    def reset(self, context: PlannerContext) -> None:
        self._context, self._map = context, NuPlanMap(context.network, self.kit)
        self._path, self._route = None, []
        self._states.clear()

    def act(self, observation: Observation) -> Trajectory:
        """Ask, where it is time, and follow the answer."""
        o = observation
        now = self.kit.TimePoint(round(o.time * 1e6))
        self._states.append((ego_state(self.kit, o.ego, now), detections(self.kit, o, now)))
        fresh = self._tell_route(o)
        if fresh or o.step - self._asked >= self.every:
            self._asked = o.step
            self._times, self._poses = self._ask(o, now)
        left = self._times - o.time
        ahead = left > _SOON_S
        if not ahead.any():
            raise InputError(f"{self._name()}: its trajectory ends before it is asked again")
        return Trajectory(left[ahead], self._poses[ahead])

    def _tell_route(self, o: Observation) -> bool:
        """Initialise the planner where the navigation leads another way than it was told."""
        if o.route.path is self._path:
            return False
        self._path = path = o.route.path
        told = self._map.route_ids(path.edges)
        if told == self._route[-len(told) :]:
            return False
        self._route = told
        x, y = path.line.point_at(path.destination_s)
        goal = self.kit.StateSE2(x, y, path.line.heading_at(path.destination_s))
        # IDMPlanner asks for two roadblocks at least, and nuPlan's own routes name some twice.
        ids = told * 2 if len(told) == 1 else list(told)
        self._planner.initialize(self.kit.PlannerInitialization(ids, goal, self._map))
        return True

    def _ask(self, o: Observation, now: Any) -> tuple[Array, Array]:
        """(times of the episode (k,), poses of the centre (k, 3)) of the planner's trajectory."""
        states, tracks = (list(part) for part in zip(*self._states, strict=True))
        history = self.kit.SimulationHistoryBuffer(states, tracks, self._context.dt)
        asked = self.kit.PlannerInput(self.kit.SimulationIteration(now, o.step), history, [])
        # nuPlan's has no place for plates, and is frozen.
        object.__setattr__(asked, "traffic_signs", o.signs)
        answer = self._planner.compute_planner_trajectory(asked)
        rows = [_row(state) for state in answer.get_sampled_trajectory()]
        kept = np.array([row for row in rows if row[0] > o.time + _SOON_S])
        if not len(kept):
            raise InputError(f"{self._name()}: no state of its trajectory is later than now ({o.time:.1f} s)")
        return kept[:, 0], kept[:, 1:]

    def _name(self) -> str:
        return type(self._planner).__name__


def adapted(source: str, named: str, where: str) -> type[NuPlanPlanner]:
    """The class that drives what `nuplan:source:named` names: a class or a factory, with literals as arguments.

    where: begins the line of an InputError.
    """
    attribute, bracket, _ = named.partition("(")
    make: Any = import_attribute(source, attribute, where)
    try:
        call = ast.parse(named if bracket else f"{named}()", mode="eval").body
        if not isinstance(call, ast.Call):
            raise ValueError(named)
        given = [ast.literal_eval(value) for value in call.args]
        by_name = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
    except (SyntaxError, ValueError):
        raise InputError(f"{where}: write arguments as in {attribute}(horizon=4.0, offsets=[-1, 1])") from None

    made = {"make": staticmethod(partial(make, *given, **by_name))}
    return type(attribute, (NuPlanPlanner,), made)


def _row(state: Any) -> tuple[float, float, float, float]:
    """Time (s) and pose of the centre. The rear axle counts: a planner may think of a car with other overhangs."""
    pose = state.rear_axle
    c, s = np.cos(pose.heading), np.sin(pose.heading)
    x, y = pose.x + EGO.wheelbase / 2 * c, pose.y + EGO.wheelbase / 2 * s
    return state.time_point.time_us * 1e-6, float(x), float(y), float(pose.heading)
