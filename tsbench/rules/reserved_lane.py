"""Keep out of a lane reserved for buses or cyclists. Source: docs/spec/rules.md, "Reserved lane". Units: m, s, rad."""

from __future__ import annotations

import math

import numpy as np

from tsbench.geometry.footprint import boxes_overlap
from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.events import EventLog, Excursion
from tsbench.rules.lines import reverse_edges
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, EgoState, WorldSnapshot

_KINDS = {"bus": ActorKind.BUS, "bicycle": ActorKind.BICYCLE}
_EGO_RADIUS_M = math.hypot(EGO_LENGTH_M, EGO_WIDTH_M) / 2


class ReservedLane(Monitor):
    """The ego's centre, or a good part of its body, is in a reserved lane for too long, or it touches a user."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._log = EventLog(sign, rule)
        params = sign.params_as(ReservedLaneParams)
        self._lanes = frozenset(scene.network.lane_index[lane] for lane in params.lanes)
        self._edges = frozenset(scene.network.lanes[i].edge for i in self._lanes)
        self._beside = {e for edge in self._edges for e in (edge, *reverse_edges(scene.network, edge))}
        self._road = self.road((params.approach, *params.zone_edges))
        self._plate = self._road.starts[sign.edge] + sign.position_m
        self._kind = int(_KINDS[rule.option("users")])
        self._inside = Excursion(self._log, "in_reserved_lane")
        self._contact = Excursion(self._log, "contact")
        self._run: list[WorldSnapshot] = []
        self._partly = Excursion(self._log, "in_reserved_lane")
        self._partly_run: list[WorldSnapshot] = []
        self._told = self._engaged = False

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
        self._judge_part(snapshot)
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

    def _judge_part(self, snapshot: WorldSnapshot) -> None:
        """One more tick with part of the body inside; a stretch that the centre has told of already is told."""
        t, ego = self.rule.thresholds, snapshot.ego
        near = ego.lane >= 0 and self.scene.network.lanes[ego.lane].edge in self._beside
        if not near or self._share(ego) <= t["share_ratio"] or not self._past_plate(ego):
            self._partly.close()
            self._partly_run.clear()
            self._told = False
            return
        self._told = self._told or self._inside.open
        self._partly_run.append(snapshot)
        lasted = snapshot.time - self._partly_run[0].time
        if lasted > t["share_s"] + 1e-9 and not self._told:
            for tick in self._partly_run if not self._partly.open else self._partly_run[-1:]:
                self._partly.broken(tick, tick.time - self._partly_run[0].time, t["share_s"])

    def _share(self, ego: EgoState) -> float:
        """Which share of the ego's width is in a reserved lane."""
        most = 0.0
        for index in self._lanes:
            lane = self.scene.network.lanes[index]
            s, d = lane.line.project(ego.x, ego.y)
            turn = ego.heading - lane.line.heading_at(s)
            half = (EGO_WIDTH_M * abs(math.cos(turn)) + EGO_LENGTH_M * abs(math.sin(turn))) / 2
            inside = min(d + half, lane.width / 2) - max(d - half, -lane.width / 2)
            most = max(most, inside / (2.0 * half))
        return most

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
        self._partly.close()
        self._contact.close()
        return self._log.verdict(self._engaged)
