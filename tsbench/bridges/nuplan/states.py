"""Stand-ins for what nuPlan's planners are told of cars, where nuplan-devkit is not installed; units: m, s, rad, us.

Names, arguments and meanings are those of nuplan-devkit 1.2 (`nuplan.common.actor_state`, `.planning.simulation`), as
far as planners use them, so both are made by the same calls (`nuplan_planner.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
import shapely

from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array

# By nuPlan's names and values.
TrackedObjectType = Enum(
    "TrackedObjectType", "VEHICLE PEDESTRIAN BICYCLE TRAFFIC_CONE BARRIER CZONE_SIGN GENERIC_OBJECT EGO", start=0
)
SemanticMapLayer = IntEnum(
    "SemanticMapLayer",
    "LANE INTERSECTION STOP_LINE TURN_STOP CROSSWALK DRIVABLE_AREA YIELD TRAFFIC_LIGHT STOP_SIGN EXTENDED_PUDO "
    "SPEED_BUMP LANE_CONNECTOR BASELINE_PATHS BOUNDARIES WALKWAYS CARPARK_AREA PUDO ROADBLOCK ROADBLOCK_CONNECTOR",
    start=0,
)
LaneConnectorType = IntEnum("LaneConnectorType", "STRAIGHT LEFT RIGHT UTURN UNKNOWN", start=0)
IntersectionType = IntEnum(
    "IntersectionType", "DEFAULT TRAFFIC_LIGHT STOP_SIGN LANE_BRANCH LANE_MERGE PASS_THROUGH", start=0
)


class _StandIn:
    """Says where a name is to be had that it lacks."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"{type(self).__name__}.{name}: a stand-in has no such name; nuplan-devkit's own has, "
            "which is not installed (docs/adapters.md)"
        )


def _alias(path: str) -> Any:
    return property(attrgetter(path))


@dataclass(frozen=True, slots=True, order=True)
class TimePoint(_StandIn):
    time_us: int

    @property
    def time_s(self) -> float:
        return self.time_us * 1e-6

    def __add__(self, other: TimePoint) -> TimePoint:
        return TimePoint(self.time_us + other.time_us)

    def __sub__(self, other: TimePoint) -> TimePoint:
        return TimePoint(self.time_us - other.time_us)


@dataclass(frozen=True, slots=True)
class Point2D(_StandIn):
    x: float
    y: float

    @property
    def array(self) -> Array:
        """(2,) x, y."""
        return np.array((self.x, self.y))

    def __iter__(self) -> Iterator[float]:
        return iter((self.x, self.y))


@dataclass(frozen=True, slots=True)
class StateSE2(Point2D):
    """A pose in the world frame."""

    heading: float

    @property
    def point(self) -> Point2D:
        return Point2D(self.x, self.y)

    def __iter__(self) -> Iterator[float]:
        return iter((self.x, self.y, self.heading))

    def serialize(self) -> list[float]:
        return [self.x, self.y, self.heading]

    def distance_to(self, state: Point2D) -> float:
        return math.hypot(self.x - state.x, self.y - state.y)

    def as_matrix(self) -> Array:
        """(3, 3) the transform from this pose's frame to the world's."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return np.array(((c, -s, self.x), (s, c, self.y), (0.0, 0.0, 1.0)))


@dataclass(frozen=True, slots=True)
class StateVector2D(Point2D):
    def magnitude(self) -> float:
        return math.hypot(self.x, self.y)


class _Sized(_StandIn):
    @property
    def half_length(self) -> float:
        return float(self.length / 2)

    @property
    def half_width(self) -> float:
        return float(self.width / 2)


@dataclass(frozen=True)
class VehicleParameters(_Sized):
    """A car's sizes; front_length and rear_length are from its rear axle to its ends."""

    width: float
    front_length: float
    rear_length: float
    cog_position_from_rear_axle: float
    wheel_base: float
    vehicle_name: str
    vehicle_type: str
    height: float

    @property
    def length(self) -> float:
        return self.front_length + self.rear_length

    @property
    def rear_axle_to_center(self) -> float:
        return self.half_length - self.rear_length


@dataclass(frozen=True)
class OrientedBox(_Sized):
    """A footprint: its centre's pose and its sizes."""

    center: StateSE2
    length: float
    width: float
    height: float

    def all_corners(self) -> list[Point2D]:
        """Front left, rear left, rear right, front right."""
        pose = self.center
        return [Point2D(*p) for p in corners(pose.x, pose.y, pose.heading, self.length, self.width)]

    @cached_property
    def geometry(self) -> shapely.Polygon:
        return shapely.Polygon([(p.x, p.y) for p in self.all_corners()])


@dataclass(frozen=True)
class CarFootprint(OrientedBox):
    """The ego's body."""

    vehicle_parameters: VehicleParameters

    @classmethod
    def build_from_center(cls, center: StateSE2, vehicle_parameters: VehicleParameters) -> CarFootprint:
        p = vehicle_parameters
        return cls(center, p.length, p.width, p.height, p)

    @property
    def oriented_box(self) -> OrientedBox:
        return self

    rear_axle_to_center_dist = _alias("vehicle_parameters.rear_axle_to_center")

    @cached_property
    def rear_axle(self) -> StateSE2:
        at, back = self.center, self.rear_axle_to_center_dist
        c, s = math.cos(at.heading), math.sin(at.heading)
        return StateSE2(at.x - c * back, at.y - s * back, at.heading)


@dataclass(frozen=True, slots=True)
class DynamicCarState(_StandIn):
    """How the ego moves, in its own frame (x ahead, y to the left), at its rear axle and its centre."""

    rear_axle_to_center_dist: float
    rear_axle_velocity_2d: StateVector2D
    rear_axle_acceleration_2d: StateVector2D
    angular_velocity: float = 0.0
    angular_acceleration: float = 0.0
    tire_steering_rate: float = 0.0

    @property
    def center_velocity_2d(self) -> StateVector2D:
        at_axle, turn = self.rear_axle_velocity_2d, self.angular_velocity
        return StateVector2D(at_axle.x, at_axle.y + self.rear_axle_to_center_dist * turn)

    @property
    def center_acceleration_2d(self) -> StateVector2D:
        at_axle, turn = self.rear_axle_acceleration_2d, self.angular_velocity
        shift = self.rear_axle_to_center_dist * (turn * turn + self.angular_acceleration)
        return StateVector2D(at_axle.x + shift, at_axle.y)

    @property
    def speed(self) -> float:
        return self.rear_axle_velocity_2d.magnitude()

    @property
    def acceleration(self) -> float:
        return self.rear_axle_acceleration_2d.magnitude()


@dataclass(frozen=True, slots=True)
class EgoState(_StandIn):
    """nuPlan's state of the ego at one time."""

    car_footprint: CarFootprint
    dynamic_car_state: DynamicCarState
    tire_steering_angle: float
    is_in_auto_mode: bool
    time_point: TimePoint

    center = _alias("car_footprint.center")
    rear_axle = _alias("car_footprint.rear_axle")
    time_us = _alias("time_point.time_us")
    time_seconds = _alias("time_point.time_s")


@dataclass(frozen=True, slots=True)
class SceneObjectMetadata(_StandIn):
    timestamp_us: int
    token: str
    track_id: int
    track_token: str
    category_name: str


@dataclass(frozen=True, slots=True)
class StaticObject(_StandIn):
    """A fixed thing."""

    tracked_object_type: TrackedObjectType
    oriented_box: OrientedBox
    metadata: SceneObjectMetadata
    velocity: StateVector2D = StateVector2D(0.0, 0.0)
    predictions: None = None

    box = _alias("oriented_box")
    center = _alias("oriented_box.center")
    track_token = _alias("metadata.track_token")
    token = _alias("metadata.token")


class Agent(StaticObject):
    """A road user. velocity: in the world frame."""

    __slots__ = ()


@dataclass(frozen=True)
class TrackedObjects(_StandIn):
    """All that is around the ego: road users in the order in which they came into sight, then fixed things."""

    tracked_objects: list[StaticObject]

    def get_tracked_objects_of_type(self, tracked_object_type: TrackedObjectType) -> list[StaticObject]:
        return self.get_tracked_objects_of_types([tracked_object_type])

    def get_tracked_objects_of_types(self, tracked_object_types: list[TrackedObjectType]) -> list[StaticObject]:
        return [one for one in self.tracked_objects if one.tracked_object_type in tracked_object_types]

    def get_agents(self) -> list[StaticObject]:
        """What moves by itself: vehicles, people, bicycles."""
        return [one for one in self.tracked_objects if isinstance(one, Agent)]

    def get_static_objects(self) -> list[StaticObject]:
        return [one for one in self.tracked_objects if not isinstance(one, Agent)]

    def __iter__(self) -> Iterator[StaticObject]:
        return iter(self.tracked_objects)

    def __len__(self) -> int:
        return len(self.tracked_objects)


@dataclass(frozen=True, slots=True)
class DetectionsTracks(_StandIn):
    """nuPlan's observation of that name."""

    tracked_objects: TrackedObjects


@dataclass(frozen=True, slots=True)
class SimulationIteration(_StandIn):
    time_point: TimePoint
    index: int

    time_us = _alias("time_point.time_us")
    time_s = _alias("time_point.time_s")


@dataclass(frozen=True, slots=True)
class SimulationHistoryBuffer(_StandIn):
    """The last 2 s, oldest first, the present last. sample_interval: s."""

    ego_state_buffer: list[EgoState]
    observations_buffer: list[DetectionsTracks]
    sample_interval: float

    @property
    def current_state(self) -> tuple[EgoState, DetectionsTracks]:
        return self.ego_states[-1], self.observations[-1]

    ego_states = _alias("ego_state_buffer")
    observations = _alias("observations_buffer")
    observation_buffer = _alias("observations_buffer")

    @property
    def size(self) -> int:
        return len(self.ego_state_buffer)


@dataclass(frozen=True)
class PlannerInitialization(_StandIn):
    """route_roadblock_ids: the navigation's way, roadblocks and connectors in order. mission_goal: its end."""

    route_roadblock_ids: list[str]
    mission_goal: StateSE2
    map_api: Any


@dataclass(frozen=True)
class PlannerInput(_StandIn):
    iteration: SimulationIteration
    history: SimulationHistoryBuffer
    traffic_light_data: list[Any]
