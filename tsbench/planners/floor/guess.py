"""Which habit fits a scene, from what is seen without plates: posts, obstacles, forks, crossings, the start.

It knows how scenes are made: distances of posts, which speeds they start with. Units: m, m/s.

`blind`: a driver that reads no plate and knows how scenes are made. `coin`: the same, by chance.

Source: docs/floor.md.

`codes`: reads what is on plates and relates it to nothing. Source: docs/floor.md.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from functools import cache
from pathlib import Path

from tsbench.core.seeds import rng_of
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.experts.rules.manoeuvre_constraint import Without, u_turns
from tsbench.planners.experts.rules.obstacle_pass import ObstaclePass
from tsbench.planners.floor.constraints import (
    BehindLeader,
    BesideUsers,
    HeldStop,
    OwnPath,
    Polite,
    SlowFrom,
    least_speed,
    limit_of,
    oncoming_path,
)
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, obstacle_ahead
from tsbench.planners.helpers import sign_ahead
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation
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


# A code and what it posts, km/h (None: nothing).
Plate = tuple[str, float | None]


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


def masked(observation: Observation) -> Observation:
    """The observation with posts in place of plates, and nothing but what all planners are given."""
    return replace(observation, signs=tuple(s.masked() for s in observation.signs), truth=None)


class Blind:
    """IDM within a habit: the behaviour that the place of posts, the road and the start tell to be safest.

    It masks plates by itself before it looks, so it drives alike with and without `--mask-signs`.
    """

    privileged = False
    sign_access = False
    chooses_route = True
    floor = True

    def __init__(self) -> None:
        self._base = Idm()
        self._context: PlannerContext
        self._habit: RuleConstraint | None = None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; who is offered more than others has it taken away."""
        self._context, self._habit = replace(context, privilege=None), None
        self._base.reset(self._context)

    def act(self, observation: Observation) -> Control:
        """The base planner's command on the habit's route, within what the habit leaves."""
        return self.drive(masked(observation))

    def drive(self, seen: Observation) -> Control:
        """The command, of what is seen without plates."""
        if self._habit is None:
            self._habit = guess(self._context, seen)
        habit = self._habit or RuleConstraint()
        route = habit.route(seen)
        command = self._base.act(replace(seen, route=route))
        least, most = habit.acceleration_bounds(seen, route)
        intent = route.path.edges if route.path.edges != seen.route.path.edges else ()
        return Control(min(max(command.acceleration, least), most), command.steering, intent)


class Coin(Blind):
    """`blind` in one episode, `idm` in the next, as a coin falls: thrown anew in each half of a pair.

    obeys: how it fell, `blind` if so.
    """

    obeys = True

    def reset(self, context: PlannerContext) -> None:
        """Throw the coin. The harness gives a floor a seed of the row, not of the pair, or both halves would agree."""
        super().reset(context)
        self.obeys = rng_of("coin", context.seed).random() < 0.5
        self._habit = None if self.obeys else RuleConstraint()


class Codes(Blind):
    """`blind` where the plates in sight stand more often in signed halves, `idm` where in contrast halves.

    It asks only which codes and values are there, not for which lane, arm, direction or way they hold. It is `blind` as
    long as a plate in sight has not faced it: the codes of some alone would say which of them face it.
    obeys: what it made of them, None as long as no plate is in sight, or not all are read.
    """

    sign_access = True
    obeys: bool | None = None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        super().reset(context)
        self.obeys = None

    def act(self, observation: Observation) -> Control:
        """The command of the driver that the first plates in sight call for."""
        plates = [(s.code, s.value) for s in observation.signs]
        if self.obeys is None and plates and all(code for code, _ in plates):
            self.obeys = signed_odds(plates, counts()) > 0.0
            if not self.obeys:
                self._habit = RuleConstraint()
        return super().act(observation)


def signed_odds(plates: Iterable[Plate], counted: Mapping[Plate, tuple[int, int]]) -> float:
    """Log odds that a row with these plates is a signed half: naive Bayes with add-one smoothing."""
    return sum(math.log((s + 1) / (c + 1)) for s, c in (counted.get(p, (0, 0)) for p in sorted(set(plates), key=str)))


@cache
def counts() -> Mapping[Plate, tuple[int, int]]:
    """In how many signed and contrast halves of the train split each plate stands (`tsbench train codes`)."""
    return read_counts(Path(__file__).with_name("codes.csv"))


def read_counts(path: Path) -> Mapping[Plate, tuple[int, int]]:
    """The counts of a file with the columns code, value (km/h, empty for none), signed, contrast."""
    with path.open(encoding="utf-8", newline="") as file:
        return {
            (r["code"], float(r["value"]) if r["value"] else None): (int(r["signed"]), int(r["contrast"]))
            for r in csv.DictReader(file)
        }
