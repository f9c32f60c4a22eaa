"""Let pedestrians cross first. Source: docs/spec/rules.md, "Crosswalk". Units: m, s, m/s, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.footprint import boxes_overlap
from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.events import EventLog, Excursion
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.plate_params import CrosswalkParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, EgoState, WorldSnapshot


class Crosswalk(Monitor):
    """Armed upstream of the crossing; judged while the ego's footprint is on it.

    u runs along the crossing's middle line from one kerb (0) to the other, w across it.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._log = EventLog(sign, rule)
        params, t = sign.params_as(CrosswalkParams), rule.thresholds
        crossing = scene.network.crossings[params.crossing]
        (self._x, self._y), (x, y) = crossing.line.points[0].tolist(), crossing.line.points[-1].tolist()
        self._length, self._width = math.hypot(x - self._x, y - self._y), crossing.width
        self._heading = math.atan2(y - self._y, x - self._x)
        self._c, self._s = math.cos(self._heading), math.sin(self._heading)
        self._middle = (x + self._x) / 2, (y + self._y) / 2
        self._road = self.road((sign.edge, params.exit))
        self._begin = self._road.line.project(*self._middle)[0] - crossing.width / 2
        self._engage, self._kerb, self._clear = (
            t["engage_distance_m"],
            t["kerb_distance_m"],
            t["clearance_m"],
        )
        self._moving, self._along, self._across = (
            t["moving_mps"],
            t["walks_along_cos"],
            t["sweeps_across_sin"],
        )
        self._near2 = (self._engage + self._length / 2 + self._width + EGO_LENGTH_M) ** 2
        self._engaged = self._armed = False
        self._drove_on = Excursion(self._log, "did_not_yield", smaller_is_worse=True)
        self._touch: dict[int, Excursion] = {}
        self._direction: dict[int, float] = {}

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        ego, actors = snapshot.ego, snapshot.actors
        people = np.flatnonzero(actors.kind == ActorKind.PEDESTRIAN).tolist()
        self._judge_contact(snapshot, people)
        dx, dy = ego.x - self._middle[0], ego.y - self._middle[1]
        if dx * dx + dy * dy > self._near2:
            self._armed = False
            self._drove_on.close()
            return
        places = [(at, *self._place(actors, at)) for at in people]
        front = self._road.front(ego)
        if front is not None and 0.0 <= self._begin - front <= self._engage:
            self._armed = True
            self._engaged = self._engaged or any(
                self._is_crossing(actors, at, u, w) for at, u, w, _ in places
            )
        on_it = self._armed and boxes_overlap(
            ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M,
            *self._middle, self._heading, self._length, self._width,
        )  # fmt: skip
        past = [self._past(ego, actors, place) for place in places if self._on_road(place[1], place[2])]
        blocking = [p for p in past if p[0] < self._clear]
        if not on_it or not blocking:
            self._drove_on.close()
        elif ego.speed > self._moving:
            value, row = min(blocking)
            self._drove_on.broken(snapshot, value, self._clear, actors.table.ids[row])

    def _place(self, actors: Actors, at: int) -> tuple[float, float, float]:
        """A pedestrian's u and w, and which way it walks along u (1 or -1)."""
        x, y, heading = actors.pose[at].tolist()
        dx, dy = x - self._x, y - self._y
        u, w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        row, along = int(actors.index[at]), math.cos(heading - self._heading)
        if abs(along) >= self._along:
            self._direction[row] = math.copysign(1.0, along)
        return u, w, self._direction.setdefault(row, 1.0 if 2.0 * u < self._length else -1.0)

    def _on_road(self, u: float, w: float) -> bool:
        """Is this place on the carriageway part of the crossing?"""
        return 0.0 <= u <= self._length and abs(w) <= self._width / 2

    def _is_crossing(self, actors: Actors, at: int, u: float, w: float) -> bool:
        """Is somebody on the crossing, or near its kerb and walking towards it?"""
        if self._on_road(u, w):
            return True
        outside = max(-u, u - self._length)
        if outside > self._kerb or abs(w) > self._width / 2 + self._kerb:
            return False
        towards = math.cos(float(actors.pose[at, 2]) - self._heading) * (1.0 if u < 0.0 else -1.0)
        return outside > 0.0 and towards >= self._along and float(actors.speed[at]) > self._moving

    def _past(
        self, ego: EgoState, actors: Actors, place: tuple[int, float, float, float]
    ) -> tuple[float, int]:
        """How far somebody has got beyond the strip that the ego sweeps (< 0: before it or in it), and its row."""
        at, u, w, direction = place
        row = int(actors.index[at])
        dx, dy = ego.x - self._x, ego.y - self._y
        ego_u, ego_w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        turn = ego.heading - self._heading
        along, across = math.cos(turn), math.sin(turn)
        if abs(across) >= self._across:
            # Where the ego's middle line passes this pedestrian's track.
            ego_u += (w - ego_w) * along / across
        half = EGO_WIDTH_M / 2 / max(abs(across), self._across)
        return direction * (u - ego_u) - half - float(actors.table.length[row]) / 2, row

    def _judge_contact(self, snapshot: WorldSnapshot, people: list[int]) -> None:
        """Clause contact, one event for each pedestrian and touch."""
        ego, actors = snapshot.ego, snapshot.actors
        touched = set()
        for at in people:
            row = int(actors.index[at])
            x, y, heading = actors.pose[at].tolist()
            size = float(actors.table.length[row]), float(actors.table.width[row])
            if boxes_overlap(ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, x, y, heading, *size):
                touched.add(row)
                excursion = self._touch.setdefault(row, Excursion(self._log, "contact"))
                excursion.broken(snapshot, 1.0, 0.0, actors.table.ids[row])
        for row, excursion in self._touch.items():
            if row not in touched:
                excursion.close()

    def finish(self) -> Verdict:
        """Excursions that are still open end with the episode."""
        for excursion in (self._drove_on, *self._touch.values()):
            excursion.close()
        return self._log.verdict(self._engaged)
