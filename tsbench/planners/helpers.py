"""Small tools for planners of one's own, exported by `tsbench`. Units: m, m/s, rad."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

from tsbench.planners.base import PlannerContext
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead, obstacle_ahead, speed_at, speed_profile
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import MapLane, RoadMap
from tsbench.signs.catalog import load_catalog

_BESIDE_M = 20.0
# Looked up once: `identified` is asked for every sign of every tick.
_codes_of_outlines = cache(lambda: load_catalog().code_of_outline)


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

    At a junction that is 3 m before the line that the rule judges: `tsbench.planners.helpers.line_ahead` has that
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
    code = "" if sign.code or not sign.outline else _codes_of_outlines().get(sign.outline, "")
    return replace(sign, code=code) if code else sign


def line_ahead(context: PlannerContext, observation: Observation, sign: SignView) -> float:
    """Distance along the route from the ego's front to the line that the sign's rule judges, negative once past.

    Signs of a junction are judged at the end of their edge; a pedestrian crossing at the near side of its strip; all
    others where the plate stands. inf: the plate's edge is not on the route, or its code is not told.
    """
    roads, route = context.network, observation.route
    lane = _lane_on(roads, route.path, sign.edge) if sign.edge else None
    if lane is None or not sign.code:
        return math.inf
    reference = load_catalog().sign(sign.code).placement.reference
    if reference == "crossing":
        return _near_side(roads, route.path, sign) - route.s - HALF_LENGTH_M
    at = lane.line.length if reference == "line" else sign.position_m
    return route.path.line.project(*lane.line.point_at(at))[0] - route.s - HALF_LENGTH_M


def _lane_on(roads: RoadMap, path: RoutePath, edge: str) -> MapLane | None:
    """The lane on which the route first leaves an edge; None where it does not lead over it."""
    found: MapLane | None = None
    for lane in (roads.lanes[piece.lane] for piece in path.pieces):
        if lane.edge == edge:
            found = lane
        elif found is not None:
            break
    return found


def _near_side(roads: RoadMap, path: RoutePath, sign: SignView) -> float:
    """Where the strip that a plate belongs to begins, along the route; without a strip, the plate's own place."""
    place = path.line.project(sign.x, sign.y)[0]
    meant = (crossing for crossing in roads.crossings.values() if sign.edge in crossing.edges)
    begins = [path.line.project(*c.line.point_at(c.line.length / 2))[0] - c.width / 2 for c in meant]
    return min(begins, key=lambda s: abs(s - place), default=place)
