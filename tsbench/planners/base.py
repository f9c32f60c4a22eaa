"""The planner contract: what a planner sees, and what it gives back. Units: m, s, m/s, rad.

A planner is a class with `reset(context)` and `act(observation) -> Control | Trajectory`, or a function
`observation -> Control`. The runner times it; nothing in here is written to by a planner.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from tsbench.geometry.polyline import Array
from tsbench.roads.destination import Destination
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import Actors, EgoState


@dataclass(frozen=True, slots=True)
class Control:
    """Acceleration (m/s2) and steering angle (rad, left positive); clipped to the vehicle's limits.

    intent: edges that the ego means to drive from where it is, as a driver's indicators tell others; () = the
    navigation's way. Other traffic goes by it when it gives way.
    """

    acceleration: float
    steering: float
    intent: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Future poses that the harness's own tracker follows.

    times: (k,) s from now, increasing, first > 0. poses: (k, 3) x, y, heading of the ego's centre in the
    world frame. intent: as in `Control`.
    """

    times: Array
    poses: Array
    intent: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class SignView:
    """A sign as a planner sees it. With masked signs, `code` is "" and `value` None: an anonymous object.

    distance: m from the ego's centre in a straight line; edge, lane (order, -1 = all lanes) and position_m:
    where its line is.
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


@dataclass(frozen=True, slots=True)
class Observation:
    """Everything that a planner may see at one tick.

    ego: own state; history: (h, 4) x, y, heading, speed of the last ticks, oldest first, the present last.
    route: navigation path and the ego's place on it. actors: road users within range, sorted by id.
    signs: plates within range, nearest first. obstacles: fixed things within range.
    """

    step: int
    time: float
    ego: EgoState
    history: Array
    route: RouteView
    actors: Actors
    signs: tuple[SignView, ...]
    obstacles: tuple[Obstacle, ...]


@dataclass(frozen=True, slots=True)
class Privilege:
    """What experts may read beyond the observation: the target sign's rule, exactly; never the future."""

    sign: SignInstance
    rule: RuleSpec


@dataclass(frozen=True, slots=True)
class PlannerContext:
    """Given once per episode. `seed` is derived from the scenario's; `privilege` is None but for experts."""

    seed: int
    network: RoadNetwork
    graph: LaneGraph
    destination: Destination
    dt: float
    privilege: Privilege | None = None


@runtime_checkable
class Planner(Protocol):
    """What the runner calls.

    A planner with `privileged = True` is given `PlannerContext.privilege` and flagged in results.
    """

    def reset(self, context: PlannerContext) -> None:
        """Start an episode: drop all state of the one before."""

    def act(self, observation: Observation) -> Control | Trajectory:
        """One command for the next 0.1 s."""
