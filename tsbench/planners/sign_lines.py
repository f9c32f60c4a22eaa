"""Where the rule of a plate begins to judge, along the route. Units: m."""

from __future__ import annotations

import math

from tsbench.planners.base import Observation, PlannerContext, SignView
from tsbench.planners.common.swept_path import HALF_LENGTH_M
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import Crossing, MapLane, RoadMap
from tsbench.signs.catalog import load_catalog


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
    begins = [_begin(path, crossing) for crossing in roads.crossings.values() if sign.edge in crossing.edges]
    return min(begins, key=lambda s: abs(s - place), default=place)


def _begin(path: RoutePath, crossing: Crossing) -> float:
    middle = crossing.line.point_at(crossing.line.length / 2)
    return path.line.project(*middle)[0] - crossing.width / 2
