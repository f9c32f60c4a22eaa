"""Pass an obstacle on a side that the sign allows. Source: docs/rules.md, "Detour". Units: m, rad.

Sides are those of the obstacle's lane.
"""

from __future__ import annotations

import math

from tsbench.geometry.footprint import boxes_overlap
from tsbench.rules.monitor import Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import ObstacleParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, EgoState, WorldSnapshot, ego_box


class Detour(Monitor):
    """Armed upstream of the obstacle; judged while the ego's footprint is beside it.

    A centre within the obstacle's own width is on no side: such an ego touches it.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        wanted = sign.params_as(ObstacleParams).obstacle
        o = self._obstacle = next(o for o in scene.obstacles if o.id == wanted)
        lane = scene.network.lane(o.lane)
        self._road = self.road((lane.edge,), lane.order)
        self._lanes = [x for x in scene.network.edge_lanes(lane.edge) if x.permits("passenger")]
        at, _ = lane.line.project(o.x, o.y)
        heading = lane.line.heading_at(at)
        self._c, self._s = math.cos(heading), math.sin(heading)
        turn = o.heading - heading
        c, s = abs(math.cos(turn)), abs(math.sin(turn))
        self._half_length = (o.length * c + o.width * s) / 2
        self._half_width = (o.width * c + o.length * s) / 2
        self._begin = at - self._half_length
        self._engage = rule.thresholds["engage_distance_m"]
        self._near2 = (self._engage + self._half_length + EGO_LENGTH_M) ** 2
        self._allowed = rule.options["allowed_sides"]
        self._armed = False
        self._wrong = self.excursion("wrong_side")
        self._contact = self.excursion("contact")
        self._off = self.excursion("off_carriageway")

    def step(self, snapshot: WorldSnapshot) -> None:
        ego, o = snapshot.ego, self._obstacle
        dx, dy = ego.x - o.x, ego.y - o.y
        if dx * dx + dy * dy > self._near2:
            self._armed = False
            for excursion in (self._wrong, self._contact, self._off):
                excursion.close()
            return
        front = self._road.front(ego)
        if front is not None and 0.0 <= self._begin - front <= self._engage:
            self._armed = self.engaged = True
        beside = dy * self._c - dx * self._s
        if self._armed and self._spans(ego, dx * self._c + dy * self._s):
            self._judge(snapshot, beside)
        else:
            self._wrong.close()
            self._off.close()
        if boxes_overlap(*ego_box(ego), o.x, o.y, o.heading, o.length, o.width):
            self._contact.broken(snapshot, 1.0, 0.0, o.id)
        else:
            self._contact.close()

    def _spans(self, ego: EgoState, along: float) -> bool:
        """Does the footprint overlap the obstacle's span? `along`: the centre's place, from its middle."""
        c = abs(math.cos(ego.heading) * self._c + math.sin(ego.heading) * self._s)
        s = math.sqrt(max(1.0 - c * c, 0.0))
        return abs(along) <= self._half_length + (EGO_LENGTH_M * c + EGO_WIDTH_M * s) / 2

    def _judge(self, snapshot: WorldSnapshot, beside: float) -> None:
        """Clauses wrong_side and off_carriageway. `beside`: the centre's offset from the obstacle's."""
        ego, name = snapshot.ego, self._obstacle.id
        on_side = abs(beside) > self._half_width
        allowed = ("left" if beside > 0.0 else "right") in self._allowed
        if on_side and not allowed:
            self._wrong.broken(snapshot, abs(beside), self._half_width, name)
        else:
            self._wrong.close()
        if on_side and allowed and not ego.on_road:
            self._off.broken(snapshot, self._outside(ego), 0.0, name)
        else:
            self._off.close()

    def _outside(self, ego: EgoState) -> float:
        """How far the centre is from the nearest lane strip of the obstacle's edge."""
        offsets = (abs(x.line.project(ego.x, ego.y)[1]) - x.width / 2 for x in self._lanes)
        return max(min(offsets, default=0.0), 0.0)
