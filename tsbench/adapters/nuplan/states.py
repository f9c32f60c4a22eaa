"""What nuPlan's planners are told of cars, under nuPlan's names. Units: m, s, m/s, m/s2, rad; time_us: us.

Names and meanings follow nuplan-devkit 1.2 (`nuplan.common.actor_state`), as far as tsbench knows what they ask for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
import shapely

from tsbench.geometry.footprint import corners
from tsbench.geometry.polyline import Array
from tsbench.planners.base import Observation
from tsbench.planners.geometry import EGO
from tsbench.sim.world import ActorKind
from tsbench.sim.world import EgoState as Ego

HALF_BASE_M = EGO.wheelbase / 2


class TrackedObjectType(Enum):
    """Kinds of objects, by nuPlan's names and values."""

    VEHICLE = 0
    PEDESTRIAN = 1
    BICYCLE = 2
    TRAFFIC_CONE = 3
    BARRIER = 4
    CZONE_SIGN = 5
    GENERIC_OBJECT = 6
    EGO = 7


_KINDS = {
    ActorKind.CAR: "VEHICLE",
    ActorKind.BUS: "VEHICLE",
    ActorKind.BICYCLE: "BICYCLE",
    ActorKind.PEDESTRIAN: "PEDESTRIAN",
}
_THINGS = {"cones": "TRAFFIC_CONE"}


@dataclass(frozen=True, slots=True)
class TimePoint:
    time_us: int

    @property
    def time_s(self) -> float:
        return self.time_us * 1e-6


@dataclass(frozen=True, slots=True)
class Point2D:
    x: float
    y: float

    @property
    def array(self) -> Array:
        """(2,) x, y."""
        return np.array((self.x, self.y))


@dataclass(frozen=True, slots=True)
class StateSE2:
    """A pose in the world frame."""

    x: float
    y: float
    heading: float

    @property
    def point(self) -> Point2D:
        return Point2D(self.x, self.y)

    @property
    def array(self) -> Array:
        """(2,) x, y."""
        return np.array((self.x, self.y))

    def serialize(self) -> list[float]:
        return [self.x, self.y, self.heading]

    def as_matrix(self) -> Array:
        """(3, 3) the transform from this pose's frame to the world's."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return np.array(((c, -s, self.x), (s, c, self.y), (0.0, 0.0, 1.0)))


@dataclass(frozen=True, slots=True)
class StateVector2D:
    x: float
    y: float

    @property
    def array(self) -> Array:
        """(2,) x, y."""
        return np.array((self.x, self.y))

    def magnitude(self) -> float:
        return math.hypot(self.x, self.y)


@dataclass(frozen=True)
class OrientedBox:
    """A footprint: its centre's pose, length and width. The height is always 1.5 m; nothing here uses it."""

    center: StateSE2
    length: float
    width: float
    height: float = 1.5

    @property
    def half_length(self) -> float:
        return self.length / 2

    @property
    def half_width(self) -> float:
        return self.width / 2

    def all_corners(self) -> list[Point2D]:
        """Front left, rear left, rear right, front right."""
        pose = self.center
        return [Point2D(*p) for p in corners(pose.x, pose.y, pose.heading, self.length, self.width)]

    @cached_property
    def geometry(self) -> shapely.Polygon:
        return shapely.Polygon([(p.x, p.y) for p in self.all_corners()])


@dataclass(frozen=True, slots=True)
class ObjectMetadata:
    timestamp_us: int
    track_token: str
    track_id: int
    category_name: str


@dataclass(frozen=True, slots=True)
class TrackedObject:
    """A road user or a fixed thing. velocity: in the world frame."""

    tracked_object_type: Enum
    box: OrientedBox
    velocity: StateVector2D
    metadata: ObjectMetadata
    predictions: None = None

    @property
    def center(self) -> StateSE2:
        return self.box.center

    @property
    def track_token(self) -> str:
        return self.metadata.track_token

    @property
    def token(self) -> str:
        return self.metadata.track_token


class TrackedObjects:
    """All that is around the ego; made when first asked for. types: the enum that kinds are told in."""

    def __init__(self, observation: Observation, time: TimePoint, types: type[Enum]) -> None:
        self._observation, self._time, self._types = observation, time, types

    @cached_property
    def tracked_objects(self) -> list[TrackedObject]:
        """Road users in the order in which they came into sight, then fixed things."""
        actors, found = self._observation.actors, []
        for k, ((x, y, heading, length, width), speed) in enumerate(
            zip(actors.boxes, actors.speed.tolist(), strict=True)
        ):
            velocity = StateVector2D(speed * math.cos(heading), speed * math.sin(heading))
            kind = _KINDS[ActorKind(int(actors.kind[k]))]
            found.append(
                self._object(kind, StateSE2(x, y, heading), length, width, velocity, int(actors.ids[k]))
            )
        for k, o in enumerate(self._observation.obstacles):
            pose = StateSE2(o.x, o.y, o.heading)
            kind = _THINGS.get(o.shape, "BARRIER")
            found.append(self._object(kind, pose, o.length, o.width, StateVector2D(0.0, 0.0), -1 - k))
        return found

    def _object(
        self, kind: str, pose: StateSE2, length: float, width: float, velocity: StateVector2D, number: int
    ) -> TrackedObject:
        metadata = ObjectMetadata(self._time.time_us, str(number), number, kind.lower())
        return TrackedObject(self._types[kind], OrientedBox(pose, length, width), velocity, metadata)

    def get_tracked_objects_of_type(self, kind: Enum) -> list[TrackedObject]:
        return [one for one in self.tracked_objects if one.tracked_object_type == kind]

    def get_tracked_objects_of_types(self, kinds: list[Enum]) -> list[TrackedObject]:
        return [one for one in self.tracked_objects if one.tracked_object_type in kinds]

    def get_agents(self) -> list[TrackedObject]:
        """What moves by itself: vehicles, people, bicycles."""
        return [one for one in self.tracked_objects if one.metadata.track_id >= 0]

    def get_static_objects(self) -> list[TrackedObject]:
        return [one for one in self.tracked_objects if one.metadata.track_id < 0]

    def __iter__(self) -> Iterator[TrackedObject]:
        return iter(self.tracked_objects)

    def __len__(self) -> int:
        return len(self.tracked_objects)


@dataclass(frozen=True, slots=True)
class DetectionsTracks:
    """nuPlan's observation of that name."""

    tracked_objects: TrackedObjects


@dataclass(frozen=True, slots=True)
class CarFootprint:
    """The ego's body; its axles are half a wheelbase before and behind its centre."""

    center: StateSE2
    rear_axle: StateSE2

    @property
    def oriented_box(self) -> OrientedBox:
        return OrientedBox(self.center, EGO.length, EGO.width)

    @property
    def length(self) -> float:
        return EGO.length

    @property
    def width(self) -> float:
        return EGO.width


@dataclass(frozen=True, slots=True)
class DynamicCarState:
    """How the ego moves, in its own frame (x ahead, y to the left), at its rear axle and its centre."""

    rear_axle_velocity_2d: StateVector2D
    rear_axle_acceleration_2d: StateVector2D
    center_velocity_2d: StateVector2D
    center_acceleration_2d: StateVector2D
    angular_velocity: float
    tire_steering_rate: float = 0.0
    angular_acceleration: float = 0.0

    @property
    def speed(self) -> float:
        return self.center_velocity_2d.magnitude()

    @property
    def acceleration(self) -> float:
        return self.center_acceleration_2d.magnitude()


@dataclass(frozen=True, slots=True)
class EgoState:
    """nuPlan's state of the ego at one time."""

    car_footprint: CarFootprint
    dynamic_car_state: DynamicCarState
    tire_steering_angle: float
    time_point: TimePoint

    @classmethod
    def of(cls, ego: Ego, time: TimePoint) -> EgoState:
        """From tsbench's, whose pose is the centre's and whose speed is along the heading."""
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        center = StateSE2(ego.x, ego.y, ego.heading)
        rear = StateSE2(ego.x - c * HALF_BASE_M, ego.y - s * HALF_BASE_M, ego.heading)
        ahead, onward = StateVector2D(ego.speed, 0.0), StateVector2D(ego.acceleration, 0.0)
        moving = DynamicCarState(ahead, onward, ahead, onward, ego.yaw_rate)
        return cls(CarFootprint(center, rear), moving, ego.steering, time)

    @property
    def center(self) -> StateSE2:
        return self.car_footprint.center

    @property
    def rear_axle(self) -> StateSE2:
        return self.car_footprint.rear_axle

    @property
    def time_us(self) -> int:
        return self.time_point.time_us

    @property
    def time_seconds(self) -> float:
        return self.time_point.time_s
