"""Turns that a sign allows at a junction. Source: docs/rules.md, "Turns and directions". Degrees in evidence."""

from __future__ import annotations

import math

from tsbench.geometry.elementary import U_TURN, turn_class, wrap
from tsbench.roads.lane_graph import heading_change
from tsbench.roads.network import RoadNetwork
from tsbench.rules.lines import is_out
from tsbench.rules.monitor import Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import JunctionParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EgoState, WorldSnapshot


class Manoeuvre(Monitor):
    """Armed on the approach, resolved where the ego has left the junction, at each pass; for each edge that it enters.

    One that was not completed when the episode ends is no manoeuvre.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._network = scene.network
        params = sign.params_as(JunctionParams)
        self._line = self.line_of(params.approach)
        # Heading change by edge entered, and +1 where it is driven in its own direction, -1 against it.
        self._exits = _exits(scene.network, params.approach, params.junction)
        self._straight = rule.thresholds["straight_deg"]
        self._u_turn = rule.thresholds["u_turn_deg"]
        self._allowed = rule.options["allowed"]
        self._armed = self._passed = False
        # Of this pass: edges entered, and kinds of manoeuvre that were told.
        self._entered: set[str] = set()

    def step(self, snapshot: WorldSnapshot) -> None:
        ego = snapshot.ego
        if ego.lane in self._line.lanes:
            self._armed = self.engaged = True
            to_go = self._line.to_go(ego)
            self._passed = to_go is not None and to_go < 0.0
            if not self._passed:
                self._entered.clear()
        elif self._armed and ego.lane >= 0:
            self._behind(snapshot)

    def _behind(self, snapshot: WorldSnapshot) -> None:
        """The centre has left the approach's own lanes."""
        ego = snapshot.ego
        lane = self._network.lanes[ego.lane]
        if lane.internal:
            self._passed = True
            return
        if not self._passed:
            # Beside the approach on the other side of its road, or turned round before the junction.
            self._begin(ego)
            return
        found = self._exits.get(lane.edge)
        if found is None:
            self._armed = self._passed = False
            return
        change, direction = found
        # Against these tests: a corner of another arm's strip, or its first metres, brushed in passing.
        if not is_out(ego, lane, at_start=direction > 0.0):
            return
        if direction * math.cos(ego.heading - lane.line.heading_at(ego.s)) <= 0.0:
            # Turned round behind the junction.
            self._begin(ego)
        elif lane.edge not in self._entered:
            self._entered.add(lane.edge)
            self._judge(snapshot, math.degrees(change), ego)

    def _begin(self, ego: EgoState) -> None:
        """A new pass, if the ego drives towards the junction on the other side of its own road."""
        to_go = self._line.to_go(ego)
        self._armed = to_go is not None
        self._passed = to_go is not None and to_go < 0.0
        self._entered.clear()

    def _judge(self, snapshot: WorldSnapshot, change: float, ego: EgoState) -> None:
        kind = turn_class(change, self._straight, self._u_turn)
        self.resolved(snapshot, ego)
        if kind in self._allowed or kind in self._entered:
            return
        self._entered.add(kind)
        # The bound of the class that the change lies beyond.
        bound = self._u_turn if kind == U_TURN else self._straight
        threshold = -bound if change < 0.0 else bound
        self.log.event("prohibited_manoeuvre", snapshot, snapshot.time, change, threshold)
        self.log.mark(snapshot.step)

    def resolved(self, snapshot: WorldSnapshot, ego: EgoState) -> None:
        """The tick at which the ego has entered an arm; for rules that ask for more than the manoeuvre."""


def _exits(network: RoadNetwork, approach: str, junction: str) -> dict[str, tuple[float, float]]:
    """By ordinary edge of the junction: change of heading (rad) for an ego that leaves by it, and direction.

    An arm's incoming edge counts too: an ego that drives out on it has made the turn, on the wrong side.
    """
    out = {
        e.id: (heading_change(network, approach, e.id), 1.0)
        for e in network.edges.values()
        if not e.internal and e.source == junction
    }
    own = network.edge_lanes(approach)[0].line
    start = own.heading_at(own.length - 1.0)
    for e in network.edges.values():
        if not e.internal and e.target == junction and e.id != approach and e.id not in out:
            line = network.edge_lanes(e.id)[0].line
            end = line.heading_at(line.length - 1.0)
            out[e.id] = (wrap(end + math.pi - start), -1.0)
    return out
