"""The reward of CaRL: the share of the route driven, cut by soft penalties, and an end with every infraction; and what
a violation costs.

Source: Jaeger et al., "CaRL: Learning Scalable Planning Policies with Simple Rewards", arXiv 2504.17838. Signs are no
part of it, and here only where `violation` or `needless` is set: limits are the road's own. Units: m, m/s, m/s2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsbench.episode.outcome import Outcome
from tsbench.learn.shared_inputs import RouteSpeed
from tsbench.planners.helpers import RoadAhead
from tsbench.planners.observation import Observation


@dataclass(frozen=True, slots=True)
class RewardSpec:
    """Each soft penalty is a factor that falls from 1 at `*_free` to `least` at `*_most`.

    overspeed: m/s above the limit. offset: m beside the route. lateral: m/s2 sideways. brake: m/s2 of braking.
    approach: 1/s, one over the time to collision with what is next on the route. infraction: reward of a collision, of
    leaving the road and of not arriving in time. progress: what the whole route is worth. violation: reward of each
    violation of a sign's rule, and of driving the wrong way; needless: of each act of needless obedience; both are
    negative where they count.
    """

    least: float = 0.4
    overspeed_free: float = 0.5
    overspeed_most: float = 3.0
    offset_free: float = 0.6
    offset_most: float = 2.5
    lateral_free: float = 2.5
    lateral_most: float = 5.0
    brake_free: float = 4.0
    brake_most: float = 6.0
    approach_free: float = 1.0 / 3.0
    approach_most: float = 1.0
    infraction: float = -1.0
    progress: float = 1.0
    violation: float = 0.0
    needless: float = 0.0


# A violation or an act of needless obedience costs as much as the whole way is worth.
SIGNS = RewardSpec(violation=-1.0, needless=-1.0)


class RouteReward:
    def __init__(self, first: Observation, spec: RewardSpec) -> None:
        self._spec = spec
        self._whole = max(first.route.remaining, 1.0)
        self._left = first.route.remaining
        self._speed = RouteSpeed()
        self._road = RoadAhead()

    def tick(self, o: Observation) -> float:
        """What the tick that led here has earned. Way that was lost is not earned twice."""
        gained = self._left - o.route.remaining
        if not gained > 0.0:
            return 0.0
        self._left = o.route.remaining
        return self._spec.progress * (gained / self._whole * self._factor(o))

    def end(self, outcome: Outcome) -> float:
        """What the end of the episode adds: the last metres on arrival, or an infraction."""
        if outcome is Outcome.ARRIVED:
            return self._spec.progress * (self._left / self._whole)
        return 0.0 if outcome.is_error else self._spec.infraction

    def _factor(self, o: Observation) -> float:
        s, ego, route = self._spec, o.ego, o.route
        over = ego.speed - self._speed.limit(route)
        # Three seconds ahead: what is farther does not count yet.
        gap, lead = self._road.gap(o, 3.0 * ego.speed + 5.0)
        approach = (ego.speed - lead) / max(gap, 0.1)
        return math.prod(
            (
                _fall(over, s.overspeed_free, s.overspeed_most, s.least),
                _fall(abs(route.d), s.offset_free, s.offset_most, s.least),
                _fall(abs(ego.speed * ego.yaw_rate), s.lateral_free, s.lateral_most, s.least),
                _fall(-ego.acceleration, s.brake_free, s.brake_most, s.least),
                _fall(approach, s.approach_free, s.approach_most, s.least),
            )
        )


def _fall(value: float, free: float, most: float, least: float) -> float:
    """1 up to `free`, `least` from `most` on, straight between."""
    return 1.0 - (1.0 - least) * min(max((value - free) / (most - free), 0.0), 1.0)
