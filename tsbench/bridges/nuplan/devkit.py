"""nuPlan's own classes where nuplan-devkit is importable, else the stand-ins for them; filled in the same way."""

from __future__ import annotations

import math
from functools import cache
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any, cast

from tsbench.bridges.nuplan import nuplan_map, states
from tsbench.planners.geometry import EGO
from tsbench.planners.observation import Observation
from tsbench.planners.planner_spec import import_attribute
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
