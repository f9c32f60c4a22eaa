"""Pedestrians on a crossing, or about to step onto it, in the ego's way. Units: m, m/s, rad.

Source: docs/rules.md, "Crosswalk".
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tsbench.roads.road_map import Crossing
from tsbench.sim.world import EGO_WIDTH_M, Actors


class PedestrianPlace(NamedTuple):
    """A pedestrian's: u along the crossing's middle line from one kerb (0) to the other, w across it.

    at: among the road users of the tick. row: in their table. direction: which way it walks along u (1 or -1).
    """

    at: int
    row: int
    u: float
    w: float
    direction: float


class CrossingPeople:
    """One crossing. thresholds: those of the rule `crosswalk`. Remembers which way each pedestrian walked last."""

    def __init__(self, crossing: Crossing, thresholds: Mapping[str, float]) -> None:
        (self._x, self._y), (x, y) = crossing.line.points[0].tolist(), crossing.line.points[-1].tolist()
        self.length, self.width = math.hypot(x - self._x, y - self._y), crossing.width
        self.heading = math.atan2(y - self._y, x - self._x)
        self.middle = (x + self._x) / 2, (y + self._y) / 2
        self._c, self._s = math.cos(self.heading), math.sin(self.heading)
        self._kerb, self._clear = thresholds["kerb_distance_m"], thresholds["clearance_m"]
        self._moving, self._along = thresholds["moving_mps"], thresholds["walks_along_cos"]
        self._across = thresholds["sweeps_across_sin"]
        self._direction: dict[int, float] = {}

    def places(self, actors: Actors, people: Sequence[int]) -> list[PedestrianPlace]:
        """Of the pedestrians among a tick's road users."""
        return [self._place(actors, at) for at in people]

    def anyone_in_the_way(self, x: float, y: float, heading: float, actors: Actors, people: Sequence[int]) -> bool:
        """Is a pedestrian on the crossing and not clear of the ego's strip, or about to step onto it?

        x, y, heading: a pose of the ego's, where it is or where it will cross; its strip goes straight on from there.
        """
        return any(
            self.past(x, y, heading, actors, p) < self._clear if self.is_on_it(p) else self.is_about_to_step(actors, p)
            for p in self.places(actors, people)
        )

    def is_on_it(self, place: PedestrianPlace) -> bool:
        """Is this place on the carriageway part of the crossing?"""
        return 0.0 <= place.u <= self.length and abs(place.w) <= self.width / 2

    def is_about_to_step(self, actors: Actors, place: PedestrianPlace) -> bool:
        """Is a pedestrian near the kerb, and walking towards it?"""
        at, _, u, w, _ = place
        outside = max(-u, u - self.length)
        if outside > self._kerb or abs(w) > self.width / 2 + self._kerb:
            return False
        towards = math.cos(float(actors.pose[at, 2]) - self.heading) * (1.0 if u < 0.0 else -1.0)
        return outside > 0.0 and towards >= self._along and float(actors.speed[at]) > self._moving

    def past(self, x: float, y: float, heading: float, actors: Actors, place: PedestrianPlace) -> float:
        """How far a pedestrian has got beyond the strip swept from a pose of the ego's (< 0: before it or in it)."""
        _, row, u, w, direction = place
        dx, dy = x - self._x, y - self._y
        ego_u, ego_w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        turn = heading - self.heading
        along, across = math.cos(turn), math.sin(turn)
        if abs(across) >= self._across:
            # Where the ego's middle line passes this pedestrian's track.
            ego_u += (w - ego_w) * along / across
        half = EGO_WIDTH_M / 2 / max(abs(across), self._across)
        return float(direction * (u - ego_u) - half - actors.table.length[row] / 2)

    def _place(self, actors: Actors, at: int) -> PedestrianPlace:
        x, y, heading = actors.pose[at].tolist()
        dx, dy = x - self._x, y - self._y
        u, w = dx * self._c + dy * self._s, dy * self._c - dx * self._s
        row, along = int(actors.index[at]), math.cos(heading - self.heading)
        if abs(along) >= self._along:
            self._direction[row] = math.copysign(1.0, along)
        return PedestrianPlace(at, row, u, w, self._direction.setdefault(row, 1.0 if 2.0 * u < self.length else -1.0))
