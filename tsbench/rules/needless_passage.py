"""Passing a line or a crossing without a reason to wait: standing there, and approaching slowly to look.

Source: docs/contrast.md, "Needless obedience". Units: m, s, m/s.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tsbench.core.errors import InputError
from tsbench.geometry.polyline import join
from tsbench.roads.blocking import PriorityGap, blockers, clearance_s
from tsbench.roads.junction_paths import junction_paths, path_zones
from tsbench.roads.priority import RULE_FOLLOWING, PriorityVehicles
from tsbench.rules.crossing import CrossingPeople
from tsbench.rules.monitor import Monitor, Verdict
from tsbench.rules.open_speed import Leaders, MeanSpeeds, OpenSpeed, OtherLimits, at_metre, bend_speeds
from tsbench.signs.annotations import SignInstance
from tsbench.signs.contrast import PassageParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M, ActorKind, EgoState, WorldSnapshot

_TICK_SHARE_S = DT_S / 2


class Passage:
    """Where the ego is on it, in metres from its line, and whether anybody makes it wait. end: of the passage."""

    def __init__(self, monitor: Monitor, params: PassageParams) -> None:
        scene, network, t = monitor.scene, monitor.scene.network, monitor.rule.thresholds
        ways = junction_paths(network, (params.approach,))
        paths = [p for p in ways if p.target.edge == params.exit]
        if not paths:
            raise InputError(
                f"{scene.additional}: clause needless: {params.approach!r} does not lead to {params.exit!r}"
            )
        self._road = monitor.road((params.approach, params.exit))
        self._line = network.edge_lanes(params.approach)[0].line.length
        self.end = self._road.starts[params.exit] - self._line + EGO_LENGTH_M
        self._front: float | None = None
        first = paths[0]
        line = join([first.source.line, first.line, first.target.line])
        self._bends, self._source_m = bend_speeds(line, monitor.rule), first.source.line.length
        give_way = scene.catalog.rule("give_way").thresholds
        others = [
            e.id
            for e in network.edges.values()
            if e.target == network.edges[params.approach].target and not e.internal and e.id != params.approach
        ]
        self._gap, other_paths = PriorityGap.of(give_way), junction_paths(network, others)
        # A vehicle with priority may be waited for longer than the rule of giving way asks; the others may not.
        self._waits = replace(self._gap, before=t["gap_s"])
        self._zones = path_zones(paths, other_paths, least_overlap=give_way["least_overlap_m"])
        self._first = frozenset(j for j, path in enumerate(other_paths) if path.source.edge in params.main_in)
        self._vehicles = PriorityVehicles(network, other_paths, RULE_FOLLOWING)
        self._leaders, self._stands, self._near_m = Leaders(network), t["standing_mps"], t["leader_least_m"]
        self._react_s, self._free_from = t["react_s"] + _TICK_SHARE_S, -math.inf
        self._people: CrossingPeople | None = None
        for name in params.crossing:
            self._people = CrossingPeople(network.crossings[name], scene.catalog.rule("crosswalk").thresholds)
            s, _ = line.project(*self._people.middle)
            self._crosses = (*line.point_at(s), line.heading_at(s))

    def front(self, ego: EgoState) -> float | None:
        """Metres of the ego's front past the line, < 0 before it; None until it drives along this road.

        Later, where it does not, it is where it was last: turning round or aside is no way to wait.
        """
        front = self._road.front(ego)
        if front is not None:
            self._front = front - self._line
        return self._front

    def bend(self, front: float) -> float:
        """Speed that the way's bends allow."""
        return at_metre(self._bends, self._source_m + front)

    def held(self, snapshot: WorldSnapshot, front: float) -> bool:
        """Is there, or was there until a moment ago, a reason to wait?"""
        if self._blocked(snapshot, front) or self._somebody_steps_out(snapshot) or self._jam(snapshot, front):
            self._free_from = snapshot.time + self._react_s
        return snapshot.time < self._free_from

    def _blocked(self, snapshot: WorldSnapshot, front: float) -> bool:
        """Would a vehicle with priority come within `gap_s`, or is any other in the ego's way already?

        On ground that the ego's front has passed no road user is in its way.
        """
        speed, gap = snapshot.ego.speed, self._gap
        vehicles = self._vehicles.find(snapshot.actors)
        prior = [v for v in vehicles if v.path in self._first]
        for known in self._zones:
            zones = [zone if zone is not None and front < zone.a_out else None for zone in known]
            if blockers(prior, zones, front, speed, self._waits):
                return True
            for vehicle in vehicles:
                zone = zones[vehicle.path]
                if zone is not None and vehicle.s >= zone.b_in:
                    left = clearance_s(vehicle, zone, front, speed, gap.least)
                    if left is not None and left < gap.after:
                        return True
        return False

    def _somebody_steps_out(self, snapshot: WorldSnapshot) -> bool:
        """Is anybody on the crossing in the ego's way, or about to step onto it?"""
        if self._people is None:
            return False
        people = np.flatnonzero(snapshot.actors.kind == ActorKind.PEDESTRIAN).tolist()
        return self._people.anyone_in_the_way(*self._crosses, snapshot.actors, people)

    def _jam(self, snapshot: WorldSnapshot, front: float) -> bool:
        """Does a leader stand so that the ego could not leave the passage behind it, or right ahead?"""
        reach = max(self.end - front + EGO_LENGTH_M, self._near_m)
        return any(speed < self._stands for _, speed in self._leaders.within(snapshot, reach))


class NeedlessStop(Monitor):
    """Has the ego stood without a reason, from the start until it is past, longer than a moment in all?"""

    def __init__(self, params: PassageParams, sign: SignInstance, scene: Scene) -> None:
        super().__init__(sign, scene.catalog.needless, scene)
        self._passage = Passage(self, params)
        self._stood = 0.0
        self._event = self.excursion("needless_stop")

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        t, ego = self.rule.thresholds, snapshot.ego
        front = self._passage.front(ego)
        if front is None or front > self._passage.end + t["behind_m"]:
            self._event.close()
        elif not self._passage.held(snapshot, front) and ego.speed < t["standing_mps"]:
            self._stood += DT_S
            if self._stood > t["standing_s"] + _TICK_SHARE_S:
                self._event.broken(snapshot, self._stood, t["standing_s"])


class NeedlessYield(Monitor):
    """Was the ego slow without a reason: very slow at one place, or slow on the whole, on its approach or passage?"""

    def __init__(self, params: PassageParams, sign: SignInstance, scene: Scene) -> None:
        super().__init__(sign, scene.catalog.needless, scene)
        self._passage = Passage(self, params)
        self._open, self._limits = (
            OpenSpeed(scene.network, self.rule, self.rule.thresholds["cruise_ratio"]),
            OtherLimits(self),
        )
        self._means = MeanSpeeds()
        self._crept = self.excursion("needless_yield", smaller_is_worse=True)
        self._last: WorldSnapshot | None = None
        self._on_passage = False

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick."""
        t, v, passage = self.rule.thresholds, snapshot.ego.speed, self._passage
        front = passage.front(snapshot.ego)
        if front is None or front > passage.end:
            self._open.update(snapshot)
            self._judge()
            self._crept.close()
            return
        if not self._on_passage and front >= -t["before_line_m"]:
            # What was driven fast from afar makes up for nothing that is slow near the line.
            self._judge()
            self._on_passage = True
        held = passage.held(snapshot, front)
        speed = self._open.update(snapshot, min(passage.bend(front), self._limits.at(snapshot.ego)), held)
        least = t["lowest_speed_ratio"] * speed
        if v < least and speed - v >= t["least_difference_mps"]:
            self._crept.broken(snapshot, v, least)
        else:
            self._crept.close()
        if not held:
            self._means.add(v, speed)
            self._last = snapshot

    def finish(self) -> Verdict:
        """A passage that was not completed is judged as far as it went."""
        self._judge()
        return super().finish()

    def _judge(self) -> None:
        t = self.rule.thresholds
        slow = self._means.taken(t["passage_speed_ratio"], t["least_difference_mps"])
        if slow is not None and self._last is not None:
            self.log.mark(self._last.step)
            self.log.event("needless_yield", self._last, self._last.time, *slow)
