"""Small tools for planners of one's own, exported by `tsbench`. Units: m, m/s, rad."""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.planners.base import Observation, SignView
from tsbench.planners.common.speed_profile import PathSamples, speed_at, speed_profile
from tsbench.planners.common.swept_path import HALF_LENGTH_M, moving_ahead, obstacle_ahead
from tsbench.roads.lane_graph import RoutePath
from tsbench.signs.catalog import load_catalog

_BESIDE_M = 20.0


class RoadAhead:
    """The road along the route: how fast it may be driven, and what is on it. Make one per episode, in `reset`.

    lateral, decel: m/s2 in bends, and for braking before bends and lower limits.
    """

    def __init__(self, lateral: float = 2.0, decel: float = 2.0) -> None:
        self._lateral, self._decel = lateral, decel
        self._path: RoutePath | None = None
        self._samples: PathSamples
        self._speeds: list[float]

    def _look(self, observation: Observation) -> None:
        path = observation.route.path
        if path is not self._path:
            self._path, self._samples = path, PathSamples(path)
            self._speeds = speed_profile(
                path, self._samples, lateral=self._lateral, decel=self._decel, factor=1.0, top=math.inf
            )

    def speed(self, observation: Observation, preview_s: float = 0.5) -> float:
        """Greatest speed that bends and the road's own limits allow, half a second ahead."""
        self._look(observation)
        return speed_at(self._speeds, observation.route.s + preview_s * observation.ego.speed)

    def gap(self, observation: Observation, reach: float = 100.0) -> tuple[float, float]:
        """Distance from the ego's front to the nearest thing on its path, and that thing's speed; (inf, 0): nothing."""
        self._look(observation)
        s = observation.route.s
        things = moving_ahead(self._samples, s, reach, observation.actors)
        things += [(obstacle_ahead(self._samples, s, o), 0.0) for o in observation.obstacles]
        end, speed = min(things, default=(math.inf, 0.0))
        return end - s - HALF_LENGTH_M, speed


def sign_ahead(observation: Observation, sign: SignView) -> float:
    """Distance along the route from the ego's front to where a plate stands, negative once past.

    At a junction that is 3 m before the line that the rule judges: `tsbench.planners.sign_lines.line_ahead` has that
    one. inf: the plate faces other traffic, or is 20 m or more beside the route. A plate of another road may be nearer
    and is told all the same: `sign.edge in observation.route.path.edges` says whether the route leads past it.
    """
    route = observation.route
    s, d = route.path.line.project(sign.x, sign.y)
    faces = math.cos(route.path.line.heading_at(s) - sign.heading) > 0.5
    return s - route.s - HALF_LENGTH_M if faces and abs(d) < _BESIDE_M else math.inf


def identified(sign: SignView) -> SignView:
    """The sign, with the code that its outline alone says where only its back is seen.

    An octagon is 2.5, an inverted triangle 2.4, a diamond 2.1. A triangle is 2.3.1 to 2.3.3, which ask the same, and is
    taken for 2.3.1. All others are given back as they are: their code stays "".
    """
    code = "" if sign.code or not sign.outline else load_catalog().code_of_outline.get(sign.outline, "")
    return replace(sign, code=code) if code else sign
