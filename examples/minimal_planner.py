"""Follows the route, keeps its distance and obeys speed limit signs: in 20 lines."""
# ruff: noqa: ARG002

from tsbench import Control, Observation, PlannerContext, RoadAhead, pursue_route, sign_ahead


class Minimal:
    def reset(self, context: PlannerContext) -> None:
        self.road, self.limit = RoadAhead(), 99.0

    def act(self, o: Observation) -> Control:
        wanted, v = min(self.road.speed(o), self.limit), o.ego.speed
        for sign in (s for s in o.signs if s.code in ("3.24", "3.25")):
            posted, to_go = (sign.value / 3.7 if sign.code == "3.24" else 99.0), sign_ahead(o, sign)
            if to_go > 1.0:  # 3 m/s2 before the plate ...
                wanted = min(wanted, (posted**2 + 6.0 * max(to_go - 0.5 * v, 0.0)) ** 0.5)
            elif to_go > -3.0:  # ... and the limit from its line on
                self.limit = posted
        gap, lead = self.road.gap(o)
        return Control(min(3.0 * (wanted - v), lead - v + 0.3 * (gap - 2.0 - 1.5 * v), 1.5), pursue_route(o))
