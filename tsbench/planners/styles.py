"""`idm-s1` .. `idm-s4`: IDM drivers of four styles, from slow to fast; each episode's driver is drawn anew.

Source: docs/planners.md. Units: m, s, m/s, m/s2.

`cautious`, `elderly`, `assertive`: lawful drivers of three styles. Each reads plates as `reader` does.

They show that the needless clauses of contrast scenes count nothing against a lawful driver, slow or brisk.
Source: docs/planners.md, "Legal styles". Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import ClassVar

import numpy as np

from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.experts.rules.conflict_check import CrossingPlan, GapRequirement, ObservedVehicle
from tsbench.planners.experts.rules.gap_acceptance import COURTESY, RightOfWay
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.planners.reader import Reader
from tsbench.sim.nuplan import quantile_speed

_GAP_M = (2.0, 8.0)
_HEADWAY_S = (0.8, 1.7)
_ACCEL_MPS2 = (0.5, 4.0)
_DECEL_MPS2 = (0.5, 5.0)


# The rule of plates that set a greatest speed.
_GREATEST_SPEED = "speed"
_STANDS_MPS, _UNDER_WAY_MPS = 0.1, 3.0
# A slower vehicle waits itself.
_COMES_MPS = 2.0


def draw_style(band: tuple[float, float], seed: int) -> IdmParameters:
    """One driver whose cruise speed lies in a band (shares in [0, 1]) of nuPlan's moving speeds.

    How much room is kept is one rank in [0, 1]: s0 = 2 + 8 x rank, T = 0.8 + 1.7 x rank.
    """
    rng = np.random.default_rng(seed)
    cruise = quantile_speed(float(rng.uniform(*band)))
    rank = float(rng.uniform())
    return IdmParameters(
        top_speed=cruise,
        min_gap_m=_GAP_M[0] + _GAP_M[1] * rank,
        headway_s=_HEADWAY_S[0] + _HEADWAY_S[1] * rank,
        accel=float(rng.uniform(*_ACCEL_MPS2)),
        decel=float(rng.uniform(*_DECEL_MPS2)),
    )


class StyledIdm(Idm):
    """An IDM driver of one style: cruises at its own speed, or at the road's limit where that is lower."""

    band: ClassVar[tuple[float, float]]

    def reset(self, context: PlannerContext) -> None:
        self.parameters = draw_style(self.band, context.seed)
        super().reset(context)


class IdmS1(StyledIdm):
    """`idm-s1`: about 11 to 20 km/h."""

    # From 18 and not from 10 %: between the published 5 and 25 % lies a straight line, which falls to 7 km/h there.
    band = (0.18, 0.35)


class IdmS2(StyledIdm):
    """`idm-s2`: about 20 to 32 km/h."""

    band = (0.35, 0.60)


class IdmS3(StyledIdm):
    """`idm-s3`: about 32 to 44 km/h."""

    band = (0.60, 0.85)


class IdmS4(StyledIdm):
    """`idm-s4`: about 44 to 62 km/h."""

    band = (0.85, 0.99)


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
