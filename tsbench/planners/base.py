"""The planner contract: what a planner sees, and what it gives back. Units: m, s, m/s, rad.

A planner is a class with `reset(context)` and `act(observation) -> Control | Trajectory`, or a function
`observation -> Control`. The runner times it; nothing in here is written to by a planner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.roads.lane_graph import Destination, MapGraph
from tsbench.roads.network import RoadNetwork
from tsbench.roads.planner_map import PlannerMap
from tsbench.roads.road_map import RoadMap
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog, RuleSpec
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import Agents, EgoState, WorldSnapshot


@dataclass(frozen=True, slots=True)
class Control:
    """Acceleration (m/s2) and steering angle (rad, left positive); clipped to the vehicle's limits.

    intent: edges that the ego means to drive from where it is, as a driver's indicators tell others; () = the
    navigation's way. Other traffic goes by it when it gives way. plan: (k, 2) where the ego means to drive, in the
    world frame; it is kept in the trace and drawn in pictures, and nothing else comes of it.
    """

    acceleration: float
    steering: float
    intent: tuple[str, ...] = ()
    plan: Array | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Future poses that the harness's own tracker follows.

    times: (k,) s from now, increasing, first > 0: the present pose is no part of it. poses: (k, 3) x, y, heading of the
    ego's centre in the world frame; they are its plan. At most 1,000. intent: as in `Control`.
    """

    times: Array
    poses: Array
    intent: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SignView:
    """A sign as a planner sees it. With masked signs it is `masked`: an anonymous object.

    code: of the catalogue, "" where the ego has seen its back only (`from_behind`). value: the number that it sets
    (km/h), None where it sets none. x, y: where the post stands. heading: direction of travel of the traffic that it
    faces. edge, lane (order, -1 = all lanes) and position_m: whose traffic it addresses, and how far along its edge it
    stands. distance: m from the ego's centre in a straight line. outline: the plate's shape, from the front and from
    behind: octagon, inverted_triangle, diamond, triangle, circle or rectangle. main_road: the plate 8.13 beneath it:
    the two directions in which the main road leads from the junction, rad to the left of straight on, the approach
    itself at pi; () where none hangs there.
    """

    code: str
    value: float | None
    x: float
    y: float
    heading: float
    edge: str
    lane: int
    position_m: float
    distance: float
    outline: str = ""
    main_road: tuple[float, ...] = ()

    def masked(self) -> SignView:
        """What is left of it where identity is hidden: where it stands, and which way it faces."""
        return SignView(
            code="", value=None, x=self.x, y=self.y, heading=self.heading, edge="", lane=-1, position_m=math.nan,
            distance=self.distance,
        )  # fmt: skip

    def from_behind(self) -> SignView:
        """What is seen of it from behind: where it stands, which way it faces, and its outline."""
        return SignView(
            code="", value=None, x=self.x, y=self.y, heading=self.heading, edge=self.edge, lane=-1,
            position_m=self.position_m, distance=self.distance, outline=self.outline,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Observation:
    """Everything that a planner may see at one tick. Lanes and edges are those of the map.

    ego: own state; history: (h, 4) x, y, heading, speed of the ego's centre at the last ticks, oldest first, the
    present last: one row at the first tick, 20 from the twentieth on.
    route: navigation path and the ego's place on it. actors: road users within range. signs: plates within range,
    nearest first. obstacles: fixed things within range. truth: the world as it is, for experts only, else None.
    """

    step: int
    time: float
    ego: EgoState
    history: Array
    route: RouteView
    actors: Agents
    signs: tuple[SignView, ...]
    obstacles: tuple[Obstacle, ...]
    truth: WorldSnapshot | None = None


@dataclass(frozen=True, slots=True)
class Privilege:
    """What experts may read beyond what all planners see: the target sign's rule, exactly; never the future.

    sign: the target, on the edges of `network`, which is SUMO's with its priorities. catalog: signs as they bind here.
    view: from the network to the map. `Observation.truth` goes with it.
    """

    sign: SignInstance
    catalog: Catalog
    network: RoadNetwork
    view: PlannerMap

    @property
    def rule(self) -> RuleSpec:
        """What the target asks."""
        return self.catalog.sign(self.sign.code).rule


@dataclass(frozen=True, slots=True)
class PlannerContext:
    """Given once per episode; frozen and read-only throughout.

    seed: the same in both halves of a pair. network: the map, without what plates decide. privilege: None but for
    experts.
    """

    seed: int
    network: RoadMap
    graph: MapGraph
    destination: Destination
    dt: float
    privilege: Privilege | None = None


def true_world(observation: Observation) -> WorldSnapshot:
    """The world as experts see it. Raises InputError for other planners."""
    if observation.truth is None:
        raise InputError("Observation.truth is for planners with privileged = True")
    return observation.truth


@runtime_checkable
class Planner(Protocol):
    """What the runner calls.

    A planner with `privileged = True` is given `PlannerContext.privilege` and `Observation.truth`, and flagged in
    results.
    """

    def reset(self, context: PlannerContext) -> None:
        """Start an episode: drop all state of the one before."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """One command for the next 0.1 s."""
