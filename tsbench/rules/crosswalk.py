"""Let pedestrians cross first. Source: docs/rules.md, "Crosswalk". Units: m, s, m/s."""

from __future__ import annotations

import numpy as np

from tsbench.geometry.footprint import boxes_overlap
from tsbench.rules.crossing import CrossingPeople
from tsbench.rules.monitor import Excursion, Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import CrosswalkParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, ActorKind, WorldSnapshot, ego_box


class Crosswalk(Monitor):
    """Armed upstream of the crossing; judged while the ego's footprint is on it."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        params, t = sign.params_as(CrosswalkParams), rule.thresholds
        self._people = CrossingPeople(scene.network.crossings[params.crossing], t)
        strip = self._people
        self._road = self.road((sign.edge, params.exit))
        self._begin = self._road.line.project(*strip.middle)[0] - strip.width / 2
        self._engage, self._clear, self._moving = t["engage_distance_m"], t["clearance_m"], t["moving_mps"]
        self._near2 = (self._engage + strip.length / 2 + strip.width + EGO_LENGTH_M) ** 2
        self._armed = False
        self._drove_on = self.excursion("did_not_yield", smaller_is_worse=True)
        self._touch: dict[int, Excursion] = {}

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        ego, actors = snapshot.ego, snapshot.actors
        people = np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN).tolist()
        self._judge_contact(snapshot, people)
        strip = self._people
        dx, dy = ego.x - strip.middle[0], ego.y - strip.middle[1]
        if dx * dx + dy * dy > self._near2:
            self._armed = False
            self._drove_on.close()
            return
        places = strip.places(actors, people)
        front = self._road.front(ego)
        if front is not None and 0.0 <= self._begin - front <= self._engage:
            self._armed = True
            self.engaged = self.engaged or any(strip.is_on_it(p) or strip.is_about_to_step(actors, p) for p in places)
        on_it = self._armed and boxes_overlap(*ego_box(ego), *strip.middle, strip.heading, strip.length, strip.width)
        past = [(strip.past(ego.x, ego.y, ego.heading, actors, p), p.row) for p in places if strip.is_on_it(p)]
        blocking = [p for p in past if p[0] < self._clear]
        if not on_it or not blocking:
            self._drove_on.close()
        elif ego.speed > self._moving:
            value, row = min(blocking)
            self._drove_on.broken(snapshot, value, self._clear, actors.table.ids[row])

    def _judge_contact(self, snapshot: WorldSnapshot, people: list[int]) -> None:
        """Clause contact, one event for each pedestrian and touch."""
        ego, actors = snapshot.ego, snapshot.actors
        touched = set()
        for at in people:
            row = int(actors.index[at])
            size = float(actors.table.length[row]), float(actors.table.width[row])
            x, y, heading = actors.pose[at].tolist()
            if boxes_overlap(*ego_box(ego), x, y, heading, *size):
                touched.add(row)
                if row not in self._touch:
                    self._touch[row] = self.excursion("contact")
                self._touch[row].broken(snapshot, 1.0, 0.0, actors.table.ids[row])
        for row, excursion in self._touch.items():
            if row not in touched:
                excursion.close()
