"""Which habit fits a scene, from what is seen without plates: posts, obstacles, forks, crossings, the start.

It knows how scenes are made: distances of posts, which speeds they start with. Units: m, m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.experts.rules.manoeuvre_constraint import Without, u_turns
from tsbench.planners.experts.rules.obstacle_pass import ObstaclePass
from tsbench.planners.floor.lanes import BesideUsers, OwnPath, oncoming_path
from tsbench.planners.floor.polite import Polite
from tsbench.planners.floor.speeds import BehindLeader, HeldStop, SlowFrom, least_speed, limit_of
from tsbench.planners.helpers import sign_ahead
from tsbench.planners.speed_profile import PathSamples
from tsbench.planners.swept_path import HALF_LENGTH_M, obstacle_ahead
from tsbench.roads.lane_graph import RoutePath, Turn
from tsbench.roads.road_map import RoadMap
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.world import ActorKind, EgoState

# Where scenes have their posts, in metres: into an exit that may be closed, before the end of a zone, after the start.
_CLOSED_EXIT_M = (7.5, 12.5)
_ZONE_M = 95.0
_MIN_SPEED_M = (29.0, 31.0)
_FORK_WITHIN_M = 120.0
_LONGEST_WAY_M, _SHORTEST_WAY = 900.0, 2


def guess(context: PlannerContext, seen: Observation) -> RuleConstraint | None:
    """The habit for what is ahead; None as long as nothing is in sight."""
    route = seen.route
    samples = PathSamples(route.path)
    for obstacle in seen.obstacles:
        if math.isfinite(obstacle_ahead(samples, route.s, obstacle)):
            return ObstaclePass(context, obstacle.id, (context.network.kerb_side,))
    front = route.s + HALF_LENGTH_M
    posts = sorted(front + d for s in seen.signs if 0.0 < (d := sign_ahead(seen, s)) < math.inf)
    fork = first_fork(context.network, route.path)
    if fork - route.s < _FORK_WITHIN_M:
        return _at_junction(context, seen, posts)
    return _on_road(context, seen, posts)


def other_way(context: PlannerContext, ego: EgoState, banned: AbstractSet[Turn]) -> Navigator | None:
    """Navigation without some turns, such as its own at the first fork; None where no other way leads there."""
    navigator = Navigator(Without(context.graph, banned), context.destination)
    try:
        navigator.update(ego)
    except ValueError:
        return None
    return navigator


class OtherWay(RuleConstraint):
    """Leads by a navigation of `other_way`, to the end."""

    def __init__(self, navigator: Navigator) -> None:
        self._navigator = navigator

    def route(self, observation: Observation) -> RouteView:
        return self._navigator.update(observation.ego)


def first_fork(roads: RoadMap, path: RoutePath) -> float:
    """Arc length at which the route's first edge ends; inf where it has no other."""
    for piece in path.pieces:
        lane = roads.lanes[piece.lane]
        if lane.internal or lane.edge != path.edges[0]:
            return piece.s0
    return math.inf


def _at_junction(context: PlannerContext, seen: Observation, posts: Sequence[float]) -> RuleConstraint | None:
    """Closed exit: stop before the post in it. Two ways to the destination: the other one. Else be polite."""
    route = seen.route
    first, second = route.path.edges[:2]
    begins = route.path.line.project(*context.network.edge_lanes(second)[0].line.point_at(0.0))[0]
    for post in posts:
        if _CLOSED_EXIT_M[0] < post - begins < _CLOSED_EXIT_M[1]:
            return HeldStop(post)
    # Where the way itself is the question, the destination lies beyond the fork's exit.
    if len(route.path.edges) > _SHORTEST_WAY:
        navigator = other_way(context, seen.ego, {(first, second)} | u_turns(context.graph))
        if navigator is not None and navigator.update(seen.ego).remaining < _LONGEST_WAY_M:
            return OtherWay(navigator)
    return Polite(context, first) if seen.signs else None


def _on_road(context: PlannerContext, seen: Observation, posts: Sequence[float]) -> RuleConstraint | None:
    """Least speed, crossing, reserved lane or limit, each by the place of its post."""
    if not posts:
        return None
    route, post = seen.route, posts[0]
    if _MIN_SPEED_M[0] < post - route.s - HALF_LENGTH_M < _MIN_SPEED_M[1]:
        least = least_speed(seen.ego.speed)
        if least is not None:
            return BehindLeader(post, least)
    edges = frozenset(route.path.edges)
    if any(edges.intersection(c.edges) for c in context.network.crossings.values()):
        return Polite(context, "")
    kinds = seen.actors.kind
    users = bool(((kinds == ActorKind.BUS) | (kinds == ActorKind.BICYCLE)).any())
    if not users and route.path.destination_s - post < _ZONE_M:
        return None
    other_side = oncoming_path(context, seen, post)
    if other_side is not None:
        return OwnPath(other_side)
    return BesideUsers(context) if users else SlowFrom(post, limit_of(seen.ego.speed))
