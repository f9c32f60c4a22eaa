"""No entry (3.1): the plate's edge may not be driven in its own direction. Source: docs/rules.md. Units: m."""

from __future__ import annotations

from tsbench.rules.monitor import Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


class NoEntry(Monitor):
    """Engaged near the end of every edge that leads into the closed one; broken while the front is past the plate."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        network = scene.network
        self._road = self.road((sign.edge,))
        leads = {
            network.lanes[c.from_lane].edge for c in network.connections if network.lanes[c.to_lane].edge == sign.edge
        }
        self._lines = [self.line_of(e) for e in network.edges if e in leads]
        self._plate = sign.position_m
        self._past = rule.thresholds["past_line_m"]
        self._window = rule.thresholds["engage_distance_m"]
        self._entered = self.excursion("entered")

    def step(self, snapshot: WorldSnapshot) -> None:
        ego = snapshot.ego
        if not self.engaged:
            for line in self._lines:
                to_go = line.to_go(ego) if ego.lane in line.lanes else None
                self.engaged = self.engaged or (to_go is not None and to_go <= self._window)
        front = self._road.front(ego)
        past = front - self._plate if front is not None and front <= self._road.length else None
        if past is not None and past >= self._past:
            self._entered.broken(snapshot, past, self._past)
        else:
            self._entered.close()
