"""A closed road: stop before its plate. Source: docs/rules.md, "Closed road". Units: m, m/s, s."""

from __future__ import annotations

from tsbench.geometry.footprint import corners
from tsbench.roads.localization import inside_polygon
from tsbench.rules.monitor import Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import ApproachParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, EgoState, WorldSnapshot

_TICK_SHARE_S = 1e-6


class ClosedRoad(Monitor):
    """Watches the ego's front against the plate's line, and whether it holds still before it."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        approach = sign.params_as(ApproachParams).approach
        self._road = self.road((approach, sign.edge))
        network = scene.network
        self._area = network.junctions[network.edges[approach].target].polygon
        self._line = self._road.starts[sign.edge] + sign.position_m
        self._past = rule.thresholds["past_line_m"]
        self._engage = rule.thresholds["engage_distance_m"]
        self._within = rule.thresholds["held_within_m"]
        self._still = rule.thresholds["held_speed_mps"]
        self._held_s = rule.thresholds["held_s"] - _TICK_SHARE_S
        self._since: float | None = None
        self._completed = False
        self._entered = self.excursion("entered_closed_road")

    @property
    def completed(self) -> bool:
        """The ego has held still before the plate and out of the junction: it got as far as it may."""
        return self._completed

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        front = self._road.front(snapshot.ego)
        # Out of sight of the road counts like far before the plate.
        past = front - self._line if front is not None else -self._road.length
        if -self._engage <= past <= 0.0:
            self.engaged = True
        if past >= self._past:
            self._entered.broken(snapshot, past, self._past)
        else:
            self._entered.close()
        near = -self._within <= past <= 0.0
        if near and snapshot.ego.speed <= self._still and self._is_out_of_the_junction(snapshot.ego):
            self._since = snapshot.time if self._since is None else self._since
            self._completed = self._completed or snapshot.time - self._since >= self._held_s
        else:
            self._since = None

    def _is_out_of_the_junction(self, ego: EgoState) -> bool:
        """Is no corner of the body in the junction's area?"""
        body = corners(ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M)
        return not any(inside_polygon(x, y, self._area) for x, y in body)
