"""`plant2`, blind to signs; `plant2-ft`, which reads them; and `plant2-blind`, which has learned without them.

The ways on that `plant2-ft` is shown lead to the destination, one by each exit of the junction ahead. The navigation
shows the shortest way, also where a sign forbids it. Which of the others is permitted the signs say; which of them lead
to the destination, and where their lanes lie, the road map says. Units: m, rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.geometry.polyline import Array, Polyline
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.engine import Plant2Engine
from tsbench.learn.plant2.sign_tokens import SignMemory, Vocabulary, fill_signs, vocabulary_of
from tsbench.learn.plant2.tokens import (
    RANGE_M,
    SIGN_SIDE_M,
    SIGN_TOKENS,
    TOKENS,
    Pose,
    Record,
    Records,
    Tokeniser,
    points_ahead,
    size_of,
)
from tsbench.planners.base import Control, Infer, PlannerContext, check_device
from tsbench.planners.floor.guess import masked
from tsbench.planners.observation import Observation
from tsbench.planners.weights import fitted, network
from tsbench.roads.lane_graph import Destination, MapGraph, RoutePath, heading_change
from tsbench.sim.ego import pursue
from tsbench.sim.world import DT_S, EgoState


@dataclass(frozen=True, slots=True)
class Gains:
    """speed_p (1/s), speed_d (-): on speed and acceleration; yaw_d (s): on the yaw rate that the path does not ask for.

    ahead_s, ahead_m: where on the path is steered for. most, least: m/s2. halt: a slower target (m/s) is a halt.
    """

    speed_p: float = 1.5
    speed_d: float = 0.1
    yaw_d: float = 0.02
    ahead_s: float = 0.4
    ahead_m: float = 2.0
    most: float = 2.5
    least: float = -6.0
    halt: float = 0.4


def control(path: Array, speed: float, ego: EgoState, gains: Gains, since: EgoState | None = None) -> Control:
    """The command for a path ((k, 2) m, one point each metre) and a target speed (m/s).

    since: the ego in whose frame the path is, where it has driven on from there; None: it is there. PD control on path
    and speed, in m, s, m/s and rad. There is no integral part: the vehicle does exactly what the command says, and
    without memory the plan and the ego's state alone give the command.
    """
    target_speed = 0.0 if speed < gains.halt else speed
    acceleration = gains.speed_p * (target_speed - ego.speed) - gains.speed_d * ego.acceleration
    ahead = max(gains.ahead_m, gains.ahead_s * ego.speed)
    driven = 0.0 if since is None else math.hypot(ego.x - since.x, ego.y - since.y)
    place = min(driven + ahead, float(len(path))) - 1.0
    k = min(int(place), len(path) - 2)
    share = place - k
    (px, py), (qx, qy) = path[k : k + 2] if since is None else _driven_past(path[k : k + 2], since, ego)
    tx, ty = float(px + share * (qx - px)), float(py + share * (qy - py))
    steering = pursue(0.0, 0.0, 0.0, tx, ty) if math.hypot(tx, ty) > 0.5 else 0.0
    asked = 2.0 * math.sin(math.atan2(ty, max(tx, 0.1))) / max(math.hypot(tx, ty), 1.0) * ego.speed
    steering -= gains.yaw_d * (ego.yaw_rate - asked)
    return Control(min(max(acceleration, gains.least), gains.most), steering)


def _driven_past(points: Array, since: EgoState, ego: EgoState) -> Iterator[tuple[float, float]]:
    """From the frame of an earlier ego to that of a later one."""
    c, s = math.cos(since.heading), math.sin(since.heading)
    turned, tilted = math.cos(ego.heading), math.sin(ego.heading)
    for along, left in points.tolist():
        dx, dy = c * along - s * left + since.x - ego.x, s * along + c * left + since.y - ego.y
        yield turned * dx + tilted * dy, turned * dy - tilted * dx


# Ticks that a plan is followed.
HOLD_TICKS = 2
_WINDOW_M = 15.0
# A plan that is so much nearer to another way means that one: less is a wide or a cut corner.
_MEANT_M = 1.0
_MOST_REMAINING_M = 1000.0
# A wait ends where it really goes: one that ended with the first centimetres would begin again from nothing.
_GOES_MPS = 1.5


class Plant2:
    """The planner. Its network plans every second tick; each tick follows the last plan from where the ego is.

    infer: answers its records (None: its network on the CPU); folder: of that network's weights (None: tsbench's).
    """

    privileged = False
    sign_access = False
    weights: ClassVar[str] = "plant2"
    inputs: ClassVar[np.dtype[Any]] = TOKENS
    side_m: ClassVar[float] = RANGE_M
    served_on: ClassVar[tuple[str, ...]] = ("cuda",)

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        self.infer = self.network("cpu", folder) if infer is None else infer
        self._gains = Gains()
        self._tokeniser: Tokeniser | None = None
        self._plan: Record | None = None
        self._since: EgoState

    @classmethod
    def network(cls, device: str, folder: Path | None = None) -> Infer:
        """Its network with the weights below `folder`: by the engine on a CPU, else by torch; errors of `fitted`."""
        size = size_of(network(cls.weights, folder))
        if device == "cpu":
            return fitted(cls.weights, folder, lambda weights: Plant2Engine(size, weights))
        from tsbench.learn.plant2.plant2_network import inference, network_of

        check_device(device)
        return inference(fitted(cls.weights, folder, lambda weights: network_of(size, weights)), device)

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; what is drawn of a network of roads is kept for the next episode on it."""
        self._plan = None
        if self._tokeniser is None or self._tokeniser.network is not context.network:
            self._tokeniser = Tokeniser(context.network, self.side_m)

    def act(self, observation: Observation) -> Control:
        o = observation
        if self._plan is None or o.step % HOLD_TICKS == 0:
            self._plan, self._since = self.infer(self.encode(o))[0], o.ego
            return control(self._plan["path"], self.target_speed(self._plan), o.ego, self._gains)
        return control(self._plan["path"], self.target_speed(self._plan), o.ego, self._gains, self._since)

    def encode(self, observation: Observation) -> Records:
        assert self._tokeniser is not None, "act before reset"
        return self._tokeniser.tokens(observation)

    def target_speed(self, plan: Record) -> float:
        return float(plan["speed"])


@dataclass(slots=True, eq=False)
class Way:
    """A way by one exit. s: where the ego is on it; exit_s: where it leaves the edge; turn: change of heading there."""

    edges: tuple[str, ...]
    line: Polyline
    s: float
    exit_s: float
    end_s: float
    turn: float
    shown: bool


class RouteAlternatives:
    """Ways of one episode; found anew on each ordinary lane that the ego comes to, and kept inside junctions."""

    def __init__(self, graph: MapGraph, destination: Destination) -> None:
        self._graph, self._destination = graph, destination
        self._lane = -1
        self._onward: dict[str, tuple[str, ...] | None] = {}
        self.ways: list[Way] = []
        self._intended: Way | None = None

    def watch(self, o: Observation) -> None:
        """Follow the ego: at every tick, in order; a second call at a tick changes nothing."""
        ego = o.ego
        if ego.lane not in (-1, self._lane) and not self._graph.network.lanes[ego.lane].internal:
            self._lane = ego.lane
            found = list(self._from(ego.lane, ego.s, o.route.path))
            # Shorter ones first: where a junction has more exits than there are slots, the longest ways are left out.
            self.ways = sorted(found, key=lambda way: way.end_s)[: at.WAYS]
            self._intended = next((way for way in self.ways if way.shown), None)
        for way in self.ways:
            way.s = way.line.project(ego.x, ego.y, way.s - _WINDOW_M, way.s + _WINDOW_M)[0]

    def intent(self, x: float, y: float, ahead: float) -> tuple[str, ...]:
        """Edges of the way that a plan follows: it leads to a point (world, m) `ahead` metres from here.

        () for the navigation's way, and where that is not among the ways. Where ways run together, the plan keeps its
        earlier way.
        """
        if self._intended is None:
            return ()
        # Before the exit ways differ by lane, and a lane is no turn.
        aside = {
            way: abs(way.line.project(x, y, way.s, way.s + ahead + _WINDOW_M)[1])
            for way in self.ways
            if way.exit_s < way.s + ahead
        }
        nearest = min(aside, key=aside.__getitem__, default=self._intended)
        if self._intended in aside and aside[nearest] < aside[self._intended] - _MEANT_M:
            self._intended = nearest
        return () if self._intended.shown else self._intended.edges

    def fill(self, record: at.Record, pose: Pose) -> None:
        """Write `ways` and `way_known` as seen from a pose; after `watch`."""
        for k, way in enumerate(self.ways):
            points = points_ahead(way.line, way.s, at.WAY_AHEAD_M, pose)
            record["way_known"][k] = 1
            record["ways"][k, : -at.WAY_FACTS] = (points / at.POSITION_SCALE_M).ravel()
            onward, left = ((way.exit_s - way.s) / at.POSITION_SCALE_M, min(way.end_s - way.s, _MOST_REMAINING_M))
            facts = (math.cos(way.turn), math.sin(way.turn), onward, left / at.REMAINING_SCALE_M, way.shown)
            record["ways"][k, -at.WAY_FACTS :] = facts

    def _from(self, lane: int, s: float, route: RoutePath) -> Iterator[Way]:
        edge, last = self._graph.edge_of(lane), self._destination.edge
        if edge == last:
            path = self._graph.path((edge,), lane, s, self._destination)
            if path is not None:
                yield Way(path.edges, path.line, 0.0, path.destination_s, path.destination_s, 0.0, True)
            return
        after = dict(zip(route.edges, route.edges[1:], strict=False)).get(edge)
        for exit_ in self._graph.successors(edge):
            onward = self._route(exit_)
            path = None if onward is None else self._graph.path((edge, *onward), lane, s, self._destination)
            if path is None:
                continue
            turn = heading_change(self._graph.network, edge, exit_)
            exit_s, shown = self._exit_s(path, edge), exit_ == after
            yield Way(path.edges, path.line, 0.0, exit_s, path.destination_s, turn, shown)

    def _route(self, edge: str) -> tuple[str, ...] | None:
        if edge not in self._onward:
            self._onward[edge] = self._graph.route(edge, self._destination.edge)
        return self._onward[edge]

    def _exit_s(self, path: RoutePath, edge: str) -> float:
        end = 0.0
        for piece in path.pieces:
            if self._graph.edge_of(piece.lane) != edge:
                break
            end = piece.s1
        return end


class SignTokeniser:
    """Tokens with signs and ways on, for one episode: it remembers the sign that holds."""

    def __init__(
        self,
        tokeniser: Tokeniser,
        ways: RouteAlternatives,
        vocabulary: Vocabulary,
        memory: type[SignMemory] = SignMemory,
    ) -> None:
        self._tokeniser, self.ways, self._vocabulary = tokeniser, ways, vocabulary
        self._memory = memory(tokeniser.network, vocabulary)
        self._seen: Observation | None = None

    def watch(self, o: Observation) -> None:
        """Remember the sign that holds, follow the ways: at every tick, in order. A second call changes nothing."""
        if o is not self._seen:
            self._seen = o
            self._memory.update(o)
            self.ways.watch(o)

    def fill(self, record: Record, o: Observation, pose: Pose | None = None) -> list[int]:
        """As `Tokeniser.fill`, into a record with the fields of `tokens.SIGN_TOKENS`; after `watch`."""
        origins = self._tokeniser.fill(record, o, pose)
        here = (o.ego.x, o.ego.y, o.ego.heading) if pose is None else pose
        order = self._tokeniser.network.lanes[o.ego.lane].order if o.ego.lane >= 0 else 0
        fill_signs(record, o, here, order, self._vocabulary.class_of)
        self._memory.fill(record, o, order)
        self.ways.fill(record, here)
        return origins


@dataclass(frozen=True, slots=True)
class StopPolicy:
    """When a plan halts: from which share of standing on, and what is added to it each second (1/s) after `waits` s.

    hold_s: seconds that a halt lasts beyond the last plan that halts. brakes: least deceleration of a halt, m/s2: in
    proportion to the speed alone the last half metre takes for ever, and leads over the line. Between waiting and going
    the mean speed is to creep, which is neither. The network has no memory: where nothing moves it sees the same for
    ever, so the share rises with the wait; and of many plans one is wrong, so one alone does not set it off. Chosen on
    kept-out maps: docs/finetuning.md.
    """

    share: float = 0.3
    waits: float = 5.0
    rise: float = 0.02
    hold_s: float = 1.2
    brakes: float = 3.0


class Plant2Ft(Plant2):
    """The planner. Of earlier ticks it keeps the sign that holds, the way it means, its wait, the last halt."""

    sign_access = True
    chooses_route = True
    weights: ClassVar[str] = "plant2-ft"
    inputs: ClassVar[np.dtype[Any]] = SIGN_TOKENS
    side_m: ClassVar[float] = SIGN_SIDE_M
    memory: ClassVar[type[SignMemory]] = SignMemory

    def __init__(
        self, infer: Infer | None = None, folder: Path | None = None, stop_policy: StopPolicy | None = None
    ) -> None:
        super().__init__(infer, folder)
        self._vocabulary = vocabulary_of(folder, self.weights)
        self._signs: SignTokeniser
        self._stop_policy = stop_policy or StopPolicy()
        self._stood, self._halted, self._settling = 0, -math.inf, False
        self._intent: tuple[str, ...]

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._stood, self._halted, self._settling = 0, -math.inf, False
        assert self._tokeniser is not None
        ways = RouteAlternatives(context.graph, context.destination)
        self._signs = SignTokeniser(self._tokeniser, ways, self._vocabulary, self.memory)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s; the sign that holds is remembered at ticks without a plan too."""
        self._signs.watch(observation)
        self._stood = self._stood + 1 if observation.ego.speed <= _GOES_MPS else 0
        self._settling = (observation.step - self._halted) * DT_S < self._stop_policy.hold_s
        command = super().act(observation)
        assert self._plan is not None
        stop_decision = self._stop_decision(self._plan)
        if stop_decision:
            self._halted = observation.step
        # The plan is of this tick.
        if self._since is observation.ego:
            self._intent = self._way_of(self._plan, observation.ego)
        most = -self._stop_policy.brakes if self._settling or stop_decision else math.inf
        return replace(command, acceleration=min(command.acceleration, most), intent=self._intent)

    def _way_of(self, plan: Record, ego: EgoState) -> tuple[str, ...]:
        """The way that a new plan's path leads to, for the indicators: others give way by it."""
        (x, y), c, s = plan["path"][-1].tolist(), math.cos(ego.heading), math.sin(ego.heading)
        return self._signs.ways.intent(ego.x + c * x - s * y, ego.y + s * x + c * y, math.hypot(x, y))

    def target_speed(self, plan: Record) -> float:
        """The speed of a plan, m/s; 0 where it may have to stand and the stop policy has not run out."""
        return 0.0 if self._settling or self._stop_decision(plan) else super().target_speed(plan)

    def _stop_decision(self, plan: Record) -> bool:
        policy = self._stop_policy
        return float(plan["standing"]) >= policy.share + policy.rise * max(self._stood * DT_S - policy.waits, 0.0)

    def encode(self, observation: Observation) -> Records:
        record: Records = np.zeros(1, dtype=SIGN_TOKENS)
        self._signs.watch(observation)
        self._signs.fill(record[0], observation)
        return record


class Plant2Blind(Plant2Ft):
    """`plant2-ft` that has learned with posts in place of plates. Source: docs/floor.md.

    It masks plates by itself before it looks, so it drives alike with and without `--mask-signs`.
    """

    sign_access = False
    floor = True
    weights: ClassVar[str] = "plant2-blind"

    def act(self, observation: Observation) -> Control:
        """As `Plant2Ft.act`, of what is seen without plates."""
        return super().act(masked(observation))
