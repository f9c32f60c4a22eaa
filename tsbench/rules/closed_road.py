"""A closed road: stop before its plate. Source: docs/spec/rules.md, "Closed road". Units: m, m/s, s."""

from __future__ import annotations

from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.events import EventLog, Excursion
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.plate_params import ApproachParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, WorldSnapshot

_TICK_SHARE_S = 1e-6


class ClosedRoad(Monitor):
    """Watches the ego's front against the plate's line, and whether it holds still before it."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._log = EventLog(sign, rule)
        approach = sign.params_as(ApproachParams).approach
        self._road = self.road((approach, sign.edge))
        self._exit = self._road.starts[sign.edge]
        self._line = self._exit + sign.position_m
        self._entry = scene.network.edge_lanes(approach)[0].line.length
        self._past = rule.thresholds["past_line_m"]
        self._engage = rule.thresholds["engage_distance_m"]
        self._within = rule.thresholds["held_within_m"]
        self._still = rule.thresholds["held_speed_mps"]
        self._held_s = rule.thresholds["held_s"] - _TICK_SHARE_S
        self._since: float | None = None
        self._engaged = self._completed = False
        self._entered = Excursion(self._log, "entered_closed_road")

    @property
    def completed(self) -> bool:
        """The ego has held still before the plate: it got as far as it may."""
        return self._completed

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        front = self._road.front(snapshot.ego)
        # Out of sight of the road is as good as far before the plate.
        past = front - self._line if front is not None else -self._road.length
        if -self._engage <= past <= 0.0:
            self._engaged = True
        if past >= self._past:
            self._entered.broken(snapshot, past, self._past)
        else:
            self._entered.close()
        if -self._within <= past <= 0.0 and snapshot.ego.speed <= self._still and self._clear(front):
            self._since = snapshot.time if self._since is None else self._since
            self._completed = self._completed or snapshot.time - self._since >= self._held_s
        else:
            self._since = None

    def _clear(self, front: float | None) -> bool:
        """Is the whole body out of the junction? Who stands in it has blocked it."""
        return front is not None and (front <= self._entry or front - EGO_LENGTH_M >= self._exit)

    def finish(self) -> Verdict:
        """An excursion that is still open ends with the episode."""
        self._entered.close()
        return self._log.verdict(self._engaged)
