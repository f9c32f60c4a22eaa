"""The speed that is open to the ego, whatever it makes of it: the measure of needlessly slow driving.

Source: docs/contrast.md, "Needless obedience". Units: m, s, m/s, m/s2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from tsbench.geometry.polyline import Polyline
from tsbench.roads.network import RoadNetwork
from tsbench.rules.monitor import Monitor, Zone
from tsbench.rules.speed import KMH_PER_MPS
from tsbench.signs.annotations import overruled
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.world import DT_S, EGO_LENGTH_M, EgoState, WorldSnapshot

# Bends are measured over this length: netconvert draws a turn as a few chords, whose corners are no bends.
_BEND_M = 10.0
_STRAIGHT_RAD = 0.001


class OpenSpeed:
    """The fastest at which the ego has been, and where that is slow, what a calm driver would have reached meanwhile.

    So it is no excuse to have come slowly. The limit that planners are shown and a leader near ahead hold it down as
    they do the ego; who is held up sets off anew. cruise: share of the limit that the calm driver speeds up to.
    """

    def __init__(self, network: RoadNetwork, rule: RuleSpec, cruise: float = 1.0) -> None:
        self._limits, self._leaders = network.shown_limits, Leaders(network)
        t = rule.thresholds
        self._calm, self._gap_s, self._gap_m = t["calm_mps2"], t["leader_gap_s"], t["leader_least_m"]
        self._cruise, self._limit = cruise, math.inf
        self.speed = 0.0

    def update(self, snapshot: WorldSnapshot, most: float = math.inf, held: bool = False) -> float:
        """The speed at this tick. most: what place and plates allow there. held: a road user makes the ego wait."""
        ego = snapshot.ego
        if ego.lane >= 0:
            self._limit = self._limits[ego.lane]
        limit, reach = min(self._limit, most), self._gap_m + self._gap_s * ego.speed
        led = min((v for _, v in self._leaders.within(snapshot, reach)), default=math.inf)
        reached = min(math.sqrt(self.speed**2 + 2 * self._calm * ego.speed * DT_S), self._cruise * limit)
        self.speed = ego.speed if held else max(ego.speed, min(max(self.speed, reached), limit, led))
        return self.speed


class OtherLimits:
    """The speed that limits of the scenario's other signs allow; before a zone what slows down to it calmly."""

    def __init__(self, monitor: Monitor) -> None:
        scene, self._calm = monitor.scene, monitor.rule.thresholds["calm_mps2"]
        limits = [sign for sign in scene.target_signs if scene.rule(sign).name == "speed"]
        others = (sign for sign in limits if sign.id != monitor.sign.id and not overruled(sign, limits))
        self._zones = [(Zone(monitor, sign), sign.posted / KMH_PER_MPS) for sign in others]

    def at(self, ego: EgoState) -> float:
        """The speed where the ego is; without such a limit any."""
        most = math.inf
        for zone, limit in self._zones:
            front = zone.road.front(ego)
            if front is not None and front <= zone.end:
                most = min(most, math.sqrt(limit**2 + 2.0 * self._calm * max(zone.start - front, 0.0)))
        return most


class MeanSpeeds:
    """Of the ticks of one stretch: the ego's mean speed, and that of the speed that was open to it."""

    def __init__(self) -> None:
        self._own = self._open = 0.0
        self._count = 0

    def add(self, own: float, open_speed: float) -> None:
        """One tick."""
        self._own, self._open, self._count = self._own + own, self._open + open_speed, self._count + 1

    def taken(self, ratio: float, least_difference: float) -> tuple[float, float] | None:
        """Begin anew; the ego's mean speed and `ratio` times the open one where that is more, else None.

        None too where the means differ by less than `least_difference`.
        """
        own, reached, count = self._own, self._open, self._count
        self._own = self._open = 0.0
        self._count = 0
        late = own < ratio * reached and reached - own >= least_difference * count
        return (own / count, ratio * reached / count) if late else None


def bend_speeds(line: Polyline, rule: RuleSpec) -> list[float]:
    """Speed that a line's bends allow every metre, slowed down to as calmly as one speeds up."""
    lateral, calm = rule.thresholds["lateral_mps2"], rule.thresholds["calm_mps2"]
    half = int(_BEND_M / 2)
    headings = np.unwrap([line.heading_at(float(s)) for s in range(int(line.length) + 1)])
    wide = np.pad(headings, half, mode="edge")
    turns = np.abs(wide[2 * half :] - wide[: -2 * half])
    speeds: list[float] = np.where(
        turns > _STRAIGHT_RAD, np.sqrt(lateral * _BEND_M / np.maximum(turns, _STRAIGHT_RAD)), math.inf
    ).tolist()
    for i in range(len(speeds) - 2, -1, -1):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2 * calm))
    return speeds


def at_metre(speeds: list[float], s: float) -> float:
    """Of `bend_speeds`, that at arc length s; beyond an end that of the end."""
    return speeds[min(max(round(s), 0), len(speeds) - 1)]


class Leaders:
    """Finds them, tick by tick."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
        self._next: dict[int, dict[int, float]] = {}

    def within(self, snapshot: WorldSnapshot, reach: float) -> Iterator[tuple[float, float]]:
        """Gap from the ego's front to the other's rear, and its speed, of each within `reach`."""
        ego, actors = snapshot.ego, snapshot.actors
        ahead = self._ahead(ego.lane)
        for k, lane in enumerate(actors.lane.tolist()):
            if lane in ahead:
                rear = ahead[lane] + float(actors.lane_s[k]) - float(actors.length[k])
                gap = rear - ego.s - EGO_LENGTH_M / 2
                if -EGO_LENGTH_M <= gap <= reach:
                    yield gap, float(actors.speed[k])

    def _ahead(self, lane: int) -> dict[int, float]:
        """The ego's lane and those that it leads into: where each starts, m from the first one's start."""
        found = self._next.get(lane)
        if found is None:
            # Pedestrians, too, are on no lane.
            found = self._next[lane] = {lane: 0.0} if lane >= 0 else {}
            network = self._network
            for connection in network.outgoing[lane] if lane >= 0 else ():
                at = network.lanes[lane].length
                for i in (*connection.via, connection.to_lane):
                    found.setdefault(i, at)
                    at += network.lanes[i].length
        return found
