"""Keep out of a lane reserved for buses or cyclists. Source: docs/rules.md, "Reserved lane". Units: m, s, rad."""

from __future__ import annotations

import numpy as np

from tsbench.geometry.footprint import boxes_overlap, share_in_band
from tsbench.rules.monitor import InAll, Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import ReservedLaneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EGO_WIDTH_M, ActorKind, Actors, EgoState, WorldSnapshot, ego_box

_KINDS = {"bus": ActorKind.BUS, "bicycle": ActorKind.BICYCLE}


class ReservedLane(Monitor):
    """The ego is in a reserved lane of the zone for longer in all than is tolerated, or it touches a user.

    Two measures of one clause: its centre, and a share of its footprint. One stay is one event at most.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        params = sign.params_as(ReservedLaneParams)
        reserved = [scene.network.lane(lane) for lane in params.lanes]
        self._lanes = {lane.index: lane for lane in reserved}
        self._edges = frozenset(lane.edge for lane in reserved)
        self._road = self.road((params.approach, *params.zone_edges))
        self._plate = self._road.starts[sign.edge] + sign.position_m
        self._kind = int(_KINDS[rule.option("users")])
        t = rule.thresholds
        self._share = t["share_ratio"]
        self._by_centre = InAll(self.excursion("in_reserved_lane"), t["duration_s"])
        self._by_share = InAll(self.excursion("in_reserved_lane"), t["share_s"])
        self._is_told = False
        self._contact = self.excursion("contact")

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        t, ego = self.rule.thresholds, snapshot.ego
        if not self.engaged:
            front = self._road.front(ego)
            self.engaged = front is not None and -t["engage_distance_m"] <= front - self._plate <= self._length
        past = self._past_plate(ego)
        if past and ego.lane in self._lanes:
            self._by_centre.add(snapshot, DT_S, self._by_share.open)
        else:
            self._by_centre.keep()
        if past and self._is_partly_in(ego):
            self._is_told = self._is_told or self._by_centre.open
            self._by_share.add(snapshot, DT_S, self._is_told)
        else:
            self._is_told = False
            self._by_share.keep()
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

    def _is_partly_in(self, ego: EgoState) -> bool:
        """Is more than the tolerated share of the footprint in reserved lanes?"""
        share = 0.0
        for lane in self._lanes.values():
            s, d = lane.line.project(ego.x, ego.y)
            turn = ego.heading - lane.line.heading_at(s)
            band = (0.0, lane.line.length, -lane.width / 2, lane.width / 2)
            share += share_in_band(s, d, turn, EGO_LENGTH_M, EGO_WIDTH_M, band)
        return share > self._share

    def _touched(self, ego: EgoState, actors: Actors) -> str | None:
        """The first user of the lane whose footprint overlaps the ego's."""
        for k in np.flatnonzero(actors.kind == self._kind).tolist():
            row = int(actors.index[k])
            table = actors.table
            x, y, heading = actors.pose[k].tolist()
            length, width = float(table.length[row]), float(table.width[row])
            uses = not self._edges.isdisjoint(table.routes[row])
            if uses and boxes_overlap(*ego_box(ego), x, y, heading, length, width):
                return table.ids[row]
        return None
