"""`idm`: the Intelligent Driver Model along the route; blind to signs and to what is about to cross.

`idm-s1` .. `idm-s4`: IDM drivers of four styles, from slow to fast; each episode's driver is drawn anew.
Sources: docs/planners.md; Treiber, Hennecke, Helbing, "Congested traffic states in empirical observations and
microscopic simulations", Phys. Rev. E 62, 1805 (2000). Units: m, s, m/s, m/s2, rad.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead, obstacle_ahead, speed_at, speed_profile
from tsbench.planners.lane_change import LaneChanges, follow
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.nuplan import quantile_speed
from tsbench.sim.scene import Obstacle

# The speed profile is read this far ahead in time, so that its braking is met and not only followed.
_PREVIEW_S = 0.5
_CLOSEST_M = 0.1


@dataclass(frozen=True, slots=True)
class IdmParameters:
    """A driver.

    speed_factor: desired speed over the road's limit. top_speed: desired speed at most (m/s). headway_s,
    min_gap_m, accel, decel: T, s0, a, b of the model (s, m, m/s2). lateral: greatest lateral acceleration in
    bends (m/s2). slowing: braking before bends and lower limits (m/s2). emergency: hardest braking (m/s2).
    """

    speed_factor: float = 1.0
    top_speed: float = math.inf
    headway_s: float = 1.5
    min_gap_m: float = 2.0
    accel: float = 1.5
    decel: float = 2.5
    lateral: float = 2.2
    slowing: float = 2.5
    emergency: float = 6.0


def free_road(v: float, desired: float, p: IdmParameters) -> float:
    """Acceleration on an empty road: the model's (exponent 4) below the desired speed, proportional above."""
    if v <= desired:
        ratio = v / desired
        return p.accel * (1.0 - ratio * ratio * ratio * ratio)
    # The model's own term brakes with a x (v/v0)^4 there: far too hard for a limit that drops by half.
    return max((desired - v) / _PREVIEW_S, -p.slowing)


def interaction(v: float, gap: float, lead: float, p: IdmParameters) -> float:
    """Deceleration (>= 0) for something `gap` m ahead that moves on at `lead` m/s."""
    approach = v * (v - lead) / (2.0 * math.sqrt(p.accel * p.decel))
    wanted = p.min_gap_m + max(v * p.headway_s + approach, 0.0)
    ratio = wanted / max(gap, _CLOSEST_M)
    return p.accel * ratio * ratio


class Idm:
    """The planner. Deterministic: the same observations give the same commands."""

    privileged = False
    sign_access = False
    follows_route = True

    def __init__(self, parameters: IdmParameters | None = None) -> None:
        self.parameters = parameters or IdmParameters()
        self._path: RoutePath | None = None
        self._samples: PathSamples
        self._speeds: list[float]
        self._fixed: dict[str, float] = {}
        self._lanes: LaneChanges

    def reset(self, context: PlannerContext) -> None:
        self._path = None
        self._lanes = LaneChanges(context)

    def act(self, observation: Observation) -> Control:
        route, stop = self._lanes.route(observation, observation.route)
        if route.path is not self._path:
            self._prepare(route.path)
        p, v, s = self.parameters, observation.ego.speed, route.s
        acceleration = free_road(v, speed_at(self._speeds, s + _PREVIEW_S * v), p)
        front = s + HALF_LENGTH_M
        # Beyond the way to stop comfortably plus four seconds nothing weighs in.
        reach = 15.0 + 4.0 * v + v * v / (2.0 * p.decel)
        nearest = math.inf
        for end, speed in moving_ahead(self._samples, s, reach, observation.actors):
            nearest = min(nearest, acceleration - interaction(v, end - front, speed, p))
        for obstacle in observation.obstacles:
            end = self._obstacle(obstacle, s)
            if end - front < reach and end + 10.0 > front:
                nearest = min(nearest, acceleration - interaction(v, end - front, 0.0, p))
        if stop < front + reach:
            # Somebody is in the way of the lane change: the end of the room for it is like a car that stands.
            gap = stop + p.min_gap_m - front
            nearest = min(nearest, acceleration - interaction(v, gap, 0.0, p))
        return Control(max(min(acceleration, nearest), -p.emergency), follow(route, observation.ego))

    def _prepare(self, path: RoutePath) -> None:
        """Everything that depends on the path alone."""
        p = self.parameters
        self._path = path
        self._samples = PathSamples(path)
        self._speeds = speed_profile(
            path, self._samples, lateral=p.lateral, decel=0.8 * p.slowing, factor=p.speed_factor, top=p.top_speed
        )
        self._fixed = {}

    def _obstacle(self, obstacle: Obstacle, s: float) -> float:
        """Where an obstacle begins on the path (inf: not on it); looked up once, as it does not move."""
        end = self._fixed.get(obstacle.id)
        if end is None:
            end = self._fixed[obstacle.id] = obstacle_ahead(self._samples, s, obstacle)
        return end


# Of a driver's style: least and range of T, s0, a, b by rank or draw.
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
