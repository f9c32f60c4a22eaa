"""What an environment shows, each kind of observation with its space, and its actions of two numbers.

`exit` is an action that may leave the navigation's way: the edges behind the next junction that lead to the destination
are counted from the navigation's: 0 follows it. The ego drives along a path through the one asked for as `aim` does
along the route, and tells other traffic so (`Control.intent`). Units: m, m/s, m/s2, rad.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from tsbench.learn.carl.raster import CHANNELS, MEASUREMENTS, PIXELS, RasterEncoder
from tsbench.learn.envs.seen_tables import ObjectsSeen, SceneSeen, ways_to
from tsbench.learn.ppo.vector import SIZE, VectorEncoder
from tsbench.learn.rl.actions import ACTIONS, Act, accelerate, aim
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.roads.lane_graph import RoutePath, heading_change

EXIT = "exit"
_WINDOW_M = 30.0
_PLACES = 3


class ExitAction:
    """Remembers the way that it is on; make one per environment."""

    def reset(self, context: PlannerContext) -> None:
        """An episode begins."""
        self._context = context
        self._ways = ways_to(context.graph, context.destination.edge)
        self._at = ("", "")
        self._path: RoutePath | None = None
        self._s = 0.0

    def __call__(self, first: float, second: float, third: float, observation: Observation) -> Control:
        """third: which exit, in thirds: around 1/3 the next one to the left of the navigation's, 2/3 the one after."""
        lane, graph = observation.ego.lane, self._context.graph
        # In a junction, and off all lanes, the way stands.
        if lane >= 0 and not self._context.network.lanes[lane].internal:
            edge = graph.edge_of(lane)
            asked = (edge, self._exit(edge, third, observation.route.path.edges))
            if asked != self._at:
                self._at, self._path, self._s = asked, self._way(asked, observation), 0.0
        if self._path is None:
            return aim(first, second, observation)
        ego, line = observation.ego, self._path.line
        s, d = line.project(ego.x, ego.y, self._s - _WINDOW_M, self._s + _WINDOW_M)
        self._s = s
        shown = replace(observation.route, path=self._path, s=s, d=d)
        return replace(aim(first, second, replace(observation, route=shown)), intent=self._path.edges)

    def exits(self, edge: str) -> tuple[str, ...]:
        """The edges behind an edge's end from which a way leads to the destination, from right to left."""
        found = [onward for onward in self._context.graph.successors(edge) if onward in self._ways]
        return tuple(sorted(found, key=lambda onward: (self._turn(edge, onward), onward)))

    def _turn(self, edge: str, onward: str) -> float:
        return heading_change(self._context.network, edge, onward)

    def _exit(self, edge: str, third: float, route: tuple[str, ...]) -> str:
        """Empty where the edge is the destination's, the navigation's way is elsewhere, or no way leads on."""
        if edge == self._context.destination.edge or edge not in route[:-1]:
            return ""
        found, own = self.exits(edge), route[route.index(edge) + 1]
        if own not in found:
            return ""
        place = found.index(own) + round(_PLACES * min(max(third, -1.0), 1.0))
        return found[min(max(place, 0), len(found) - 1)]

    def _way(self, asked: tuple[str, str], observation: Observation) -> RoutePath | None:
        """A path through the exit; None = the navigation's, where that goes there or no lane leads there."""
        edge, exit_ = asked
        if not exit_ or (edge, exit_) in pairwise(observation.route.path.edges):
            return None
        graph, to = self._context.graph, self._context.destination
        onward = graph.route(exit_, to.edge)
        ego = observation.ego
        return None if onward is None else graph.path((edge, *onward), ego.lane, max(ego.s, 0.0), to)


class ObservationEncoder(Protocol):
    """One kind of observation; `encode` gives elements of `space`."""

    space: spaces.Space[Any]

    def reset(self, context: PlannerContext) -> None: ...

    def encode(self, observation: Observation) -> Any: ...


class VectorSeen(VectorEncoder):
    """`vector`: the 275 numbers of `ppo`."""

    space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)


class BevSeen(RasterEncoder):
    """The raster and the measurements of `carl`."""

    space: spaces.Space[Any] = spaces.Dict(
        {
            "bev": spaces.Box(0, 255, (CHANNELS, PIXELS, PIXELS), np.uint8),
            "measurements": spaces.Box(-2.0, 2.0, (MEASUREMENTS,), np.float32),
        }
    )

    def encode(self, observation: Observation) -> Any:
        raster, measured = super().encode(observation)
        return {"bev": raster, "measurements": measured}


KINDS: dict[str, Callable[[], ObservationEncoder]] = {
    "vector": VectorSeen,
    "bev": BevSeen,
    "objects": ObjectsSeen,
    "scene": SceneSeen,
    "plates": partial(SceneSeen, lanes=False),
}


_FASTEST_MPS, _GAIN_PER_S = 25.0, 1.0


def cruise(first: float, second: float, observation: Observation) -> Control:
    """A speed to drive at, -1 = 0 and 1 = 25 m/s, and a place beside the route as `aim` has it.

    A number that does not change keeps a limit; with `aim` that needs ever new ones.
    """
    wanted = _FASTEST_MPS * (min(max(first, -1.0), 1.0) + 1.0) / 2.0
    wish = _GAIN_PER_S * (wanted - observation.ego.speed)
    command = min(max(wish, accelerate(-1.0)), accelerate(1.0))
    return replace(aim(0.0, second, observation), acceleration=command)


PLAIN: dict[str, Act] = {**ACTIONS, "cruise": cruise}
