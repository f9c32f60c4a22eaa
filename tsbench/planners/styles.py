"""`idm-s1` .. `idm-s4`: IDM drivers of four styles, from slow to fast; each episode's driver is drawn anew.

Source: docs/planners.md. Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from tsbench.planners.base import PlannerContext
from tsbench.planners.idm import Idm, IdmParameters
from tsbench.sim.nuplan import quantile_speed

_GAP_M = (2.0, 8.0)
_HEADWAY_S = (0.8, 1.7)
_ACCEL_MPS2 = (0.5, 4.0)
_DECEL_MPS2 = (0.5, 5.0)


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
