"""From two numbers in -1..1, which a network learns, to a command. Units: m, m/s, rad.

`aim` is what `ppo` and `carl` learn: the first number is the acceleration, the second how far beside the route the ego
aims. 0, 0 rolls on along the route, so that learning begins with driving and not with staying on the road. The place
aimed at enters squared, which makes small corrections fine, and lies at most a third of the look-ahead beside the
present one, which keeps swerves smooth at every speed. Both numbers hold for several ticks; the steering that they mean
is computed at each tick.
`steer` is the plain vehicle: the second number is the steering angle.
`exit` may leave the navigation's way: the edges behind the next junction that lead to the destination are counted from
the navigation's: 0 follows it. The ego drives along a path through the one asked for as `aim` does along the route, and
tells other traffic so (`Control.intent`).

`LearnedPlanner` is what `ppo` and `carl` have in common: an encoder, a network of two actions, and actions that hold
for 0.3 s. Both drive as they learned to: by draws from their densities, not by mean or mode, which hesitate where the
density leans to neither side. The draws come from the scenario's seed, one pair for each decision; quantiles of the
densities have the same bits on every CPU.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.elementary import Array, exp_of, log, log_of, polynomial
from tsbench.planners.base import Control, Infer, PlannerContext, Records
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import MapGraph, RoutePath, heading_change, shortest_ways
from tsbench.sim.ego import MAX_STEER_RAD, pursue

Act = Callable[[float, float, Observation], Control]

# Ticks that an action of `ppo` and `carl` holds: 0.3 s.
HOLD_TICKS = 3

_ACCEL_MPS2, _BRAKE_MPS2 = 2.4, 5.0
_ASIDE_M = 3.5
_ON_LINE_M = 0.5
_SLOPE = 1.0 / 3.0
_LEAST_AHEAD_M, _AHEAD_S = 2.0, 0.4
_LEAST_SWERVE_M, _SWERVE_S = 5.0, 0.9


def accelerate(value: float) -> float:
    """Acceleration (m/s2): up to 2.4 forwards (nuPlan's comfort bound), up to 5 in braking.

    Around 0 both ways are alike, so that what is learned with noise is what is driven without; hard braking is steeper.
    """
    value = min(max(value, -1.0), 1.0)
    return _ACCEL_MPS2 * value if value >= 0.0 else value * (_ACCEL_MPS2 - (_BRAKE_MPS2 - _ACCEL_MPS2) * value)


def action_for(acceleration: float, aside: float) -> tuple[float, float]:
    """The numbers with which `aim` comes closest to an acceleration (m/s2) and a place beside the route (m, left)."""
    second = math.copysign(min(math.sqrt(abs(aside) / _ASIDE_M), 1.0), aside)
    if acceleration >= 0.0:
        return min(acceleration / _ACCEL_MPS2, 1.0), second
    steeper = _BRAKE_MPS2 - _ACCEL_MPS2
    root = math.sqrt(_ACCEL_MPS2 * _ACCEL_MPS2 - 4.0 * steeper * acceleration)
    return max((_ACCEL_MPS2 - root) / (2.0 * steeper), -1.0), second


def aim(first: float, second: float, observation: Observation) -> Control:
    """Acceleration, and a lateral place to go to: 0 the route itself, 1 = 3.5 m to the left of it."""
    ego, route = observation.ego, observation.route
    second = min(max(second, -1.0), 1.0)
    wanted = _ASIDE_M * second * abs(second)
    close, far = max(_LEAST_AHEAD_M, _AHEAD_S * ego.speed), max(_LEAST_SWERVE_M, _SWERVE_S * ego.speed)
    # Near the line that it wants the ego keeps to it as tightly as `pursue_route`; else it looks farther ahead.
    away = abs(wanted - route.d)
    share = min(away / _ON_LINE_M, 1.0)
    ahead = close + share * (far - close)
    offset = route.d + min(max(wanted - route.d, -_SLOPE * ahead), _SLOPE * ahead)
    x, y = route.path.line.point_at(route.s + ahead, offset)
    return Control(accelerate(first), pursue(ego.x, ego.y, ego.heading, x, y))


def steer(first: float, second: float, observation: Observation) -> Control:  # noqa: ARG001
    """Acceleration, and the steering angle as a share of full lock, left positive."""
    return Control(accelerate(first), MAX_STEER_RAD * min(max(second, -1.0), 1.0))


_FASTEST_MPS, _GAIN_PER_S = 25.0, 1.0


def cruise(first: float, second: float, observation: Observation) -> Control:
    """A speed to drive at, -1 = 0 and 1 = 25 m/s, and a place beside the route as `aim` has it.

    A number that does not change keeps a limit; with `aim` that needs ever new ones.
    """
    wanted = _FASTEST_MPS * (min(max(first, -1.0), 1.0) + 1.0) / 2.0
    wish = _GAIN_PER_S * (wanted - observation.ego.speed)
    command = min(max(wish, accelerate(-1.0)), accelerate(1.0))
    return replace(aim(0.0, second, observation), acceleration=command)


PLAIN: dict[str, Act] = {"aim": aim, "steer": steer, "cruise": cruise}
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


def ways_to(graph: MapGraph, target: str) -> dict[str, float]:
    """From the start of each edge that leads there, m to the start of `target`, along edges."""
    edges, roads = list(graph.network.edges), graph.network.edges
    number = {edge: k for k, edge in enumerate(edges)}
    before: list[list[int]] = [[] for _ in edges]
    for edge in edges:
        for following in graph.successors(edge):
            before[number[following]].append(number[edge])

    def back(k: int, cost: float) -> Iterator[tuple[int, float]]:
        return ((source, cost + roads[edges[source]].length) for source in before[k])

    return {edges[k]: reached.cost for k, reached in shortest_ways(number[target], back).items()}


# What the networks answer: two numbers of -1..1.
TWO_ACTIONS = np.dtype([("action", np.float64, (2,))])
# What they are asked besides what is seen: which quantile of each density to answer with.
DRAW = ("draw", np.float64, (2,))
# More decisions than an episode has.
_DECISIONS = 1024


class LearnedPlanner(ABC):
    """A planner whose network decides every third tick; what that means for the vehicle is worked out at each.

    infer: answers (b,) records of `inputs` with (b,) records of `TWO_ACTIONS`, each as if alone, to the bit; None =
    a network of its own, with the weights below `folder` (None: tsbench's).
    """

    privileged = False
    sign_access = False
    follows_route = False
    inputs: ClassVar[np.dtype[Any]]

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        self.infer = self.network("cpu", folder) if infer is None else infer
        self._action: tuple[float, float] = (0.0, 0.0)
        self._draws: Array

    @staticmethod
    @abstractmethod
    def network(device: str, folder: Path | None = None) -> Infer:
        """The network on a device; InputError where the weights below `folder` are not its own."""

    def reset(self, context: PlannerContext) -> None:
        self._action = (0.0, 0.0)
        self._draws = np.random.default_rng(np.random.SeedSequence(context.seed)).random((_DECISIONS, 2))

    def act(self, observation: Observation) -> Control:
        if observation.step % HOLD_TICKS == 0:
            first, second = self.infer(self.encode(observation))["action"][0].tolist()
            self._action = first, second
        return aim(*self._action, observation)

    def encode(self, observation: Observation) -> Records:
        """(1,) record of `inputs`."""
        record: Records = np.empty(1, dtype=self.inputs)
        record["draw"][0] = self._draws[observation.step // HOLD_TICKS % _DECISIONS]
        self.fill(record, observation)
        return record

    @abstractmethod
    def fill(self, record: Records, observation: Observation) -> None: ...


# Wichura (1988), algorithm AS 241: numerators and denominators for the middle, the flanks and the tails.
_MIDDLE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4, 4.5921953931549871457e4,
     1.3731693765509461125e4, 1.9715909503065514427e3, 1.3314166789178437745e2, 3.3871328727963666080e0),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4, 2.1213794301586595867e4,
     5.3941960214247511077e3, 6.8718700749205790830e2, 4.2313330701600911252e1, 1.0),
)  # fmt: skip
_FLANKS = (
    (7.7454501427834140764e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1, 1.27045825245236838258e0,
     3.64784832476320460504e0, 5.76949722146069140550e0, 4.63033784615654529590e0, 1.42343711074968357734e0),
    (1.05075007164441684324e-9, 5.4759380849953449460e-4, 1.51986665636164571966e-2, 1.48103976427480074590e-1,
     6.8976733498510000455e-1, 1.67638483018380384940e0, 2.05319162663775882187e0, 1.0),
)  # fmt: skip
_TAILS = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3, 2.65321895265761230930e-2,
     2.96560571828504891230e-1, 1.78482653991729133580e0, 5.46378491116411436990e0, 6.65790464350110377720e0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5, 7.86869131145613259100e-4,
     1.48753612908506148525e-2, 1.36929880922735805310e-1, 5.99832206555887937690e-1, 1.0),
)  # fmt: skip
_MIDDLE_HALF, _MIDDLE_SQUARE, _FLANK_ENDS = 0.425, 0.180625, 5.0
# Far more than any quantile or continued fraction here has taken.
_ROUNDS, _TERMS = 100, 1000
_CLOSE = 1e-12


def normal_quantile(p: Array) -> Array:
    """Of the standard normal distribution, for p between 0 and 1; to 1e-15."""
    q = p - 0.5
    middle = _MIDDLE_SQUARE - q * q
    near = q * (polynomial(middle, _MIDDLE[0]) / polynomial(middle, _MIDDLE[1]))
    r = np.sqrt(-log(np.where(q <= 0.0, p, 1.0 - p)))
    flank, tail = r - 1.6, r - _FLANK_ENDS
    far = np.where(
        r <= _FLANK_ENDS,
        polynomial(flank, _FLANKS[0]) / polynomial(flank, _FLANKS[1]),
        polynomial(tail, _TAILS[0]) / polynomial(tail, _TAILS[1]),
    )
    return np.where(np.abs(q) <= _MIDDLE_HALF, near, np.copysign(far, q))


def beta_quantile(a: float, b: float, p: float) -> float:
    """Of the Beta distribution with parameters above 0, for p between 0 and 1; to 1e-11."""
    edge = (a + 1.0) / (a + b + 2.0)
    # Both sides' shares make 1: that gives the constant without a gamma function.
    whole = _power(a, b, edge) * (_fraction(a, b, edge) / a + _fraction(b, a, 1.0 - edge) / b)
    low, high, x = 0.0, 1.0, edge
    for _ in range(_ROUNDS):
        density = _power(a, b, x) / whole
        below = density * _fraction(a, b, x) / a if x <= edge else 1.0 - density * _fraction(b, a, 1.0 - x) / b
        if below > p:
            high = x
        else:
            low = x
        # Newton's step, where it stays between the bounds.
        new = x - (below - p) * x * (1.0 - x) / density
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) < _CLOSE:
            return new
        x = new
    return x


def _power(a: float, b: float, x: float) -> float:
    return exp_of(a * log_of(x) + b * log_of(1.0 - x))


def _fraction(a: float, b: float, x: float) -> float:
    """The continued fraction of the incomplete Beta function (DLMF 8.17.22, by Lentz), for x up to `edge` above."""
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, _TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        value *= c * d
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        change = c * d
        value *= change
        if abs(change - 1.0) < _CLOSE:
            return value
    raise ArithmeticError(f"the Beta distribution of {a}, {b} does not converge")
