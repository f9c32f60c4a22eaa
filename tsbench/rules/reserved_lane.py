"""Keep out of a lane reserved for buses or cyclists. Source: docs/spec/rules.md, "Reserved lane". Units: m, s, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.footprint import boxes_overlap
from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.events import EventLog, Excursion
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, EgoState, WorldSnapshot

_KINDS = {"bus": ActorKind.BUS, "bicycle": ActorKind.BICYCLE}
_EGO_RADIUS_M = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2


class ReservedLane(Monitor):
    """The ego's centre is in a reserved lane of the zone for longer than the tolerance, or it touches a user."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._log = EventLog(sign, rule)
        params = sign.params_as(ReservedLaneParams)
        self._lanes = frozenset(scene.network.lane_index[lane] for lane in params.lanes)
        self._edges = frozenset(scene.network.lanes[i].edge for i in self._lanes)
        self._road = self.road((params.approach, *params.zone_edges))
        self._plate = self._road.starts[sign.edge] + sign.position_m
        self._kind = int(_KINDS[rule.option("users")])
        self._inside = Excursion(self._log, "in_reserved_lane")
        self._contact = Excursion(self._log, "contact")
        self._run: list[WorldSnapshot] = []
        self._engaged = False

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        t, ego = self.rule.thresholds, snapshot.ego
        if not self._engaged:
            front = self._road.front(ego)
            self._engaged = (
                front is not None and -t["engage_distance_m"] <= front - self._plate <= self._length
            )
        if ego.lane in self._lanes and self._past_plate(ego):
            self._run.append(snapshot)
            self._judge(snapshot, t["duration_s"])
        else:
            self._leave()
        touched = self._touched(ego, snapshot.actors)
        if touched is None:
            self._contact.close()
        else:
            self._contact.broken(snapshot, 1.0, 0.0, touched)

    @property
    def _length(self) -> float:
        return self._road.length - self._plate

    def _past_plate(self, ego: EgoState) -> bool:
        place = self._road.place(ego)
        return place is not None and place > self._plate

    def _judge(self, snapshot: WorldSnapshot, tolerated_s: float) -> None:
        """One more tick inside: how long has it been?"""
        began = self._run[0].time
        if snapshot.time - began > tolerated_s + 1e-9:
            for tick in self._run if not self._inside.open else self._run[-1:]:
                self._inside.broken(tick, tick.time - began, tolerated_s)

    def _leave(self) -> None:
        self._inside.close()
        self._run.clear()

    def _touched(self, ego: EgoState, actors: Actors) -> str | None:
        """The first user of the lane whose footprint overlaps the ego's."""
        for k in np.flatnonzero(actors.kind == self._kind).tolist():
            row = int(actors.index[k])
            table = actors.table
            x, y, heading = actors.pose[k].tolist()
            length, width = float(table.length[row]), float(table.width[row])
            near = math.hypot(x - ego.x, y - ego.y) <= _EGO_RADIUS_M + 0.5 * (length + width)
            if near and not self._edges.isdisjoint(table.routes[row]) and boxes_overlap(
                ego.x, ego.y, ego.heading, EGO_LENGTH_M, EGO_WIDTH_M, x, y, heading, length, width
            ):  # fmt: skip
                return table.ids[row]
        return None

    def finish(self) -> Verdict:
        """Excursions that are still open end with the episode."""
        self._leave()
        self._contact.close()
        return self._log.verdict(self._engaged)
