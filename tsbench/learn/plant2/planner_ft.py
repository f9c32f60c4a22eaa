"""`plant2-ft`: `plant2` that reads signs; and `plant2-blind`, which has learned without them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.learn.plant2.layout import SIGN_SIDE_M, SIGN_TOKENS, Record, Records
from tsbench.learn.plant2.plant2_planner import Plant2
from tsbench.learn.plant2.route_alternatives import RouteAlternatives
from tsbench.learn.plant2.sign_tokens import SignMemory, fill_signs
from tsbench.learn.plant2.tokens import Pose, Tokeniser
from tsbench.learn.plant2.vocabulary import Vocabulary, vocabulary_of
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.batching import Infer
from tsbench.planners.floor.blind import masked
from tsbench.sim.world import DT_S, EgoState

# A wait ends where it really goes: one that ended with the first centimetres would begin again from nothing.
_GOES_MPS = 1.5


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

    def watch(self, o: Observation) -> None:
        """Remember the sign that holds, follow the ways: at every tick, in order. A second call changes nothing."""
        self._memory.update(o)
        self.ways.watch(o)

    def fill(self, record: Record, o: Observation, pose: Pose | None = None) -> list[int]:
        """As `Tokeniser.fill`, into a record with the fields of `layout.SIGN_TOKENS`; after `watch`."""
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

    def stop_decision(self, standing: float, waited: float) -> bool:
        """Does a plan with this share of standing halt after a wait of so many seconds?"""
        return standing >= self.share + self.rise * max(waited - self.waits, 0.0)


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
        return self._stop_policy.stop_decision(float(plan["standing"]), self._stood * DT_S)

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

    def encode(self, observation: Observation) -> Records:
        """Masked here too: answers for several observations at once are asked for without `act`."""
        return super().encode(masked(observation))
