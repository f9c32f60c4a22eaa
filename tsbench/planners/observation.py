"""What a planner sees at a tick: `Observation`, and the view of a sign in it. Units: m, s, m/s, rad.

`tsbench.episode.observer` makes it; the ego, road users, the route and obstacles are those of `tsbench.sim`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import Agents, EgoState, WorldSnapshot


@dataclass(frozen=True, slots=True)
class SignView:
    """A sign as a planner sees it. With masked signs it is `masked`: an anonymous object.

    code: of the catalogue, "" where the ego has seen its back only (`from_behind`). value: the number that it sets
    (km/h), None where it sets none. x, y: where the post stands. heading: direction of travel of the traffic that it
    faces. edge, lane (order, -1 = all lanes) and position_m: whose traffic it addresses, and how far along its edge it
    stands. distance: m from the ego's centre in a straight line. outline: the plate's shape, from the front and from
    behind: octagon, inverted_triangle, diamond, triangle, circle or rectangle. main_road: the plate 8.13 beneath it:
    the two directions in which the main road leads from the junction, rad to the left of straight on, the approach
    itself at pi; () where none hangs there. temporary: on yellow ground, as at road works.
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
    temporary: bool = False

    def masked(self) -> SignView:
        """What is left of it where identity is hidden: where it stands, and which way it faces."""
        return SignView(
            code="", value=None, x=self.x, y=self.y, heading=self.heading, edge="", lane=-1, position_m=math.nan,
            distance=self.distance,
        )  # fmt: skip

    def from_behind(self) -> SignView:
        """What is seen of it from behind: where it stands, which way it faces, and its outline."""
        return SignView(
            code="",
            value=None,
            x=self.x,
            y=self.y,
            heading=self.heading,
            edge=self.edge,
            lane=-1,
            position_m=self.position_m,
            distance=self.distance,
            outline=self.outline,
        )


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


def true_world(observation: Observation) -> WorldSnapshot:
    """The world as experts see it. Raises InputError for other planners."""
    if observation.truth is None:
        raise InputError("Observation.truth is for planners with privileged = True")
    return observation.truth
