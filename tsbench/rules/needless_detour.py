"""Leaving a way that the plates permit. Source: docs/contrast.md, "Needless obedience". Units: s."""

from __future__ import annotations

import math

from tsbench.rules.lines import is_out
from tsbench.rules.monitor import InAll, Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.contrast import WayParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EgoState, WorldSnapshot


class NeedlessDetour(Monitor):
    """Has the ego left the navigation's way, or lane, for longer than a moment in all?

    In all: who swings from lane to lane, each for a moment, would keep to both.

    Armed on the approach, disarmed once it has left the junction by the way's exit and goes on from there. Off the way
    it stays off until it comes to the approach, or to the way's exit, again.
    """

    def __init__(self, params: WayParams, sign: SignInstance, scene: Scene) -> None:
        super().__init__(sign, scene.catalog.needless, scene)
        network = self._network = scene.network
        self._approach, self._exits = params.approach, frozenset(params.exits)
        self._lanes = frozenset(network.lane_index[name] for name in params.lanes)
        self._edges = {network.lane(name).edge for name in params.lanes}
        self._junction = network.edges[params.approach].target
        self._armed = self._through = False
        self._off = InAll(self.excursion("needless_detour"), self.rule.thresholds["lane_s"])

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        if self._is_off(snapshot.ego):
            self._off.add(snapshot, DT_S)
        else:
            self._off.keep()

    def _is_off(self, ego: EgoState) -> bool:
        """Of a tick. In a junction, and beside all lanes, it is off as long as it has been."""
        lane = self._network.lanes[ego.lane] if ego.lane >= 0 else None
        if lane is None or lane.internal:
            return self._off.open
        if lane.edge == self._approach:
            self._armed, self._through = True, False
        elif lane.edge in self._exits:
            self._through = self._through or is_out(ego, lane, at_start=True)
        # Against it drives who passes something on the oncoming lane, or brushes the strip of another arm.
        elif self._armed and self._exits and math.cos(ego.heading - lane.line.heading_at(ego.s)) > 0.0:
            self._armed = not self._through or self._network.edges[lane.edge].source == self._junction
            self._through = False
            if self._armed:
                return True
        return lane.edge in self._edges and ego.lane not in self._lanes
