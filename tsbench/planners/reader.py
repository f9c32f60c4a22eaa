"""`reader` and `careful`: they obey what they are told of a plate, and only that. Units: m, s, m/s, m/s2.

An expert is told the rule; these are told it too (how to obey is no question here), but go by it only from the tick at
which their eyes have read the plate, or its outline from behind, as what it was read. So perception decides: what is
missed is not obeyed, what is misread is obeyed as that. They differ in what they do about a post that they have not
read.

`cautious`, `elderly`, `assertive`: lawful drivers of three styles, who read plates as `reader` does. They show that the
needless clauses of contrast scenes count nothing against a lawful driver, slow or brisk. Source: docs/planners.md,
"Legal styles".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import ClassVar

from tsbench.core.errors import InputError
from tsbench.planners.base import Control, PlannerContext, Privilege
from tsbench.planners.experts.expert import Expert
from tsbench.planners.experts.rules.conflict_check import CrossingPlan, GapRequirement, ObservedVehicle
from tsbench.planners.experts.rules.constraint import slow_to
from tsbench.planners.experts.rules.gap_acceptance import COURTESY, RightOfWay
from tsbench.planners.floor.guess import Blind
from tsbench.planners.helpers import identified, sign_ahead
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.observation import Observation

# Told places are off by a few metres along the road; only targets stand nearer to each other.
_SAME_POST_M = 4.0
_SLOW_WITHIN_M, _BRAKE_MPS2, _SHARE = 40.0, 2.0, 0.55
_Told = tuple[str, float | None, bool]


class Reader:
    """`idm` until a plate is read; then `idm-e` under the plates as they were read.

    driver: how it drives in both cases. reads: which of the scenario's signs.
    """

    privileged = True
    sign_access = True
    driver: ClassVar[IdmParameters] = IdmParameters()
    reads: ClassVar[slice] = slice(None)

    def __init__(self) -> None:
        self._base = Idm(self.driver)
        self._context: PlannerContext
        self._privilege: Privilege
        # Of each target by its id, as they were read: code, value, and whether it is temporary.
        self._told: dict[str, _Told] = {}
        self._expert: Expert | None = None

    def reset(self, context: PlannerContext) -> None:
        if context.privilege is None:
            raise InputError("reader and its kin need PlannerContext.privilege: privileged = True")
        self._context, self._privilege = context, context.privilege
        self._reads = [sign.id for sign in context.privilege.signs[self.reads]]
        self._told, self._expert = {}, None
        self._base.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control:
        told = self._told | self._read(observation)
        if told != self._told:
            self._told, self._expert = told, self._obeying(told)
        if self._expert is not None:
            try:
                return self._expert.act(observation)
            except InputError:
                # What was read leaves no way: it must be misread, so it is as if nothing stood there.
                if all(self._told.get(s.id) == (s.code, s.value, s.temporary) for s in self._privilege.signs):
                    raise
                self._expert = None
        return self.unread(observation, self._base.act(replace(observation, truth=None)))

    def unread(self, observation: Observation, command: Control) -> Control:
        """What becomes of a command as long as the plate is not read: nothing."""
        del observation
        return command

    def _read(self, observation: Observation) -> dict[str, _Told]:
        found: dict[str, _Told] = {}
        for seen in observation.signs:
            far, target = min((math.hypot(seen.x - s.x, seen.y - s.y), s.id) for s in self._privilege.signs)
            read = identified(seen)
            if far < _SAME_POST_M and target in self._reads and read.code:
                found.setdefault(target, (read.code, read.value, read.temporary))
        return found

    def obeyed(self, code: str, value: float | None) -> float | None:
        """The value that is obeyed of a plate that was read: its own."""
        del code
        return value

    def _obeying(self, told: Mapping[str, _Told]) -> Expert:
        """The expert that obeys the plates that were read, as they were read."""
        read = ((sign, *told[sign.id]) for sign in self._privilege.signs if sign.id in told)
        signs = tuple(
            replace(sign, code=code, value=self.obeyed(code, value), temporary=temporary)
            for sign, code, value, temporary in read
        )
        expert = Expert(Idm(self.driver))
        expert.reset(replace(self._context, privilege=replace(self._privilege, signs=signs)))
        return expert


class FirstSign(Reader):
    """Reads the first of two signs alone: how far that leads."""

    reads = slice(1)


class LastSign(Reader):
    """Reads the last of two signs alone."""

    reads = slice(-1, None)


class Careful(Reader):
    """Takes a post that it has not read for what is safest there, as `blind` does, and goes slowly towards it.

    A slow ego has more looks, and time to obey what they tell.
    """

    def __init__(self) -> None:
        super().__init__()
        self._blind = Blind()

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._blind.reset(context)

    def unread(self, observation: Observation, command: Control) -> Control:
        ego, route = observation.ego, observation.route
        posts = [sign for sign in observation.signs if not (sign.code or sign.outline)]
        if not posts:
            return command
        command = self._blind.act(observation)
        target = _SHARE * route.path.limit_at(route.s)
        most = math.inf
        for post in posts:
            ahead = sign_ahead(observation, post)
            if 0.0 < ahead < math.inf:
                most = min(most, slow_to(ego.speed, target, max(ahead - _SLOW_WITHIN_M, 0.0), _BRAKE_MPS2))
        return replace(command, acceleration=min(command.acceleration, most))


# The rule of plates that set a greatest speed.
_GREATEST_SPEED = "speed"
_STANDS_MPS, _UNDER_WAY_MPS = 0.1, 3.0
# A slower vehicle waits itself.
_COMES_MPS = 2.0


@dataclass(frozen=True)
class WideGap(GapRequirement):
    """COURTESY, and at least `lag` seconds from the ego's arrival at its line to the other vehicle's at the zone."""

    lag: float = 0.0

    @classmethod
    def of(cls, lag: float) -> WideGap:
        """A gap of so many seconds."""
        return cls(**asdict(COURTESY), lag=lag)

    def blocks(self, seen: ObservedVehicle, plan: CrossingPlan) -> bool:
        """Would this driver wait for the vehicle?"""
        speed = seen.vehicle.speed
        comes = seen.to_zone > 0.0 and speed >= _COMES_MPS
        return (comes and seen.to_zone / speed < plan.at_line + self.lag) or super().blocks(seen, plan)


class LegalStyle(Reader):
    """`reader` with another manner.

    share: of the limit that binds, the road's or the plate's, which this driver keeps to.
    """

    share: ClassVar[float] = 1.0

    def obeyed(self, code: str, value: float | None) -> float | None:
        """Of a greatest speed `share` of it."""
        rule = self._privilege.catalog.sign(code).rule
        return value if value is None or rule.name != _GREATEST_SPEED else self.share * value


class Cautious(LegalStyle):
    """Keeps to 0.9 of the limits."""

    share = 0.9
    driver = IdmParameters(speed_factor=share)


class Elderly(LegalStyle):
    """Keeps to 0.8 of the limits, waits for wide gaps, and starts late and gently after it has stood."""

    share = 0.8
    driver = IdmParameters(speed_factor=share, headway_s=2.0, lateral=1.8)
    gap_s: ClassVar[float] = 9.0
    start_s: ClassVar[float] = 1.0
    start_mps2: ClassVar[float] = 1.0

    def __init__(self) -> None:
        super().__init__()
        self._gaps: RightOfWay
        self._starts_at: float | None = None
        self._starting = False

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._gaps = RightOfWay(self._privilege, demand=WideGap.of(self.gap_s))
        self._starts_at, self._starting = None, False

    def act(self, observation: Observation) -> Control:
        """The reader's command, within what gaps and the late start leave."""
        command = super().act(observation)
        most = self._gaps.acceleration_bounds(observation, observation.route)[1]
        most = min(most, self._start(observation, min(command.acceleration, most)))
        return replace(command, acceleration=min(command.acceleration, most))

    def _start(self, observation: Observation, wanted: float) -> float:
        """After standing nothing until `start_s` after the way is free, then `start_mps2` until it is under way."""
        v, now = observation.ego.speed, observation.time
        if v < _STANDS_MPS and wanted <= 0.0:
            self._starting, self._starts_at = True, None
        if not self._starting:
            return math.inf
        if self._starts_at is None and wanted > 0.0:
            self._starts_at = now + self.start_s
        self._starting = v < _UNDER_WAY_MPS
        return 0.0 if self._starts_at is None or now < self._starts_at else self.start_mps2


class Assertive(LegalStyle):
    """Drives at the limit, speeds up and brakes hard, keeps short gaps; gives way as every lawful driver does."""

    driver = IdmParameters(headway_s=0.9, accel=2.8, decel=3.5, lateral=2.8, slowing=3.5)
