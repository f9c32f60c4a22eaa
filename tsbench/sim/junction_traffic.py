"""Traffic at a junction whose plates could be exchanged: it does not give the plates away until it is too late.

The behaviour of others shows the right of way. So until the ego waits at its line, or could no longer stop before it
meets the convoy, however late that is, SUMO's right of way moves no vehicle: the convoy comes as the release says and
stops before its own line, vehicles on other arms wait on, and new vehicles enter the scene later. An ego that could
be through before the convoy comes, if it did its utmost from now, meets it all the same: the convoy hurries. For an ego
that slows down the convoy slows down, so as not to stand at its line when the ego decides.
Source: docs/scenes.md, "Priority at junctions". Units: m, s.
"""

from __future__ import annotations

import math

from tsbench.signs.contrast import PassageParams
from tsbench.signs.rule_kinds import GiveWayParams, RoundaboutParams
from tsbench.sim.convoy import (
    KEEPS_BACK_S,
    NEAR_M,
    REACHED_AFTER_S,
    WAITS_MPS,
    Approach,
    ConvoyRelease,
    Showing,
    earliest_arrival,
    predicted_arrival,
)
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_SPEED_MPS
from tsbench.sim.scene import ConvoyPlan, Scene
from tsbench.sim.scene_file import WAITING_ID, LateEntry, late_entries
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState

# The first of a convoy stands so far before its own line at the latest, and brakes no harder than this for it: less
# than what the rule of giving way takes for forced (sign_catalog/rules/give_way.yaml).
HOLD_BEFORE_LINE_M = 1.5
HOLD_BRAKE_MPS2 = 2.3
# The same in the scenes of 2026.3.
OLD_HOLD = 3.0, 2.0
# It comes up to there at least so fast, and keeps its speed where it has no more than this in hand.
LEAST_MPS = 2.0
EVEN_S = 0.3


def exchangeable(scene: Scene) -> bool:
    """Do plates of this scene set the right of way at a junction, and differ between the halves of a pair?"""
    for sign in scene.target_signs:
        if isinstance(sign.params, GiveWayParams) and not isinstance(sign.params, RoundaboutParams):
            return True
    return any(
        c.name == "needless_yield" and isinstance(c.params, PassageParams) and not c.params.crossing
        for c in scene.contrast
    )


class JunctionTraffic:
    """Loads a scene, holds and lets go. `begin` once the ego is there; then `update` before every step."""

    def __init__(self, sim: Simulation, scene: Scene) -> None:
        self._sim = sim
        self._plan = scene.convoy
        self._convoy = scene.convoy.vehicles if scene.convoy else ()
        self._release = ConvoyRelease(scene.convoy, scene.network) if scene.convoy else None
        self._approach = self._release.approach if self._release else Approach(scene.network.lane(scene.start.lane))
        self._showing = self._release.showing if self._release else Showing()
        self._silent = exchangeable(scene)
        self._waits = self._release is not None
        self._hurries = False
        # Of each of the convoy that is there, its own top speed and acceleration.
        self._paces: dict[str, tuple[float, float]] = {}
        # Of a convoy that does not stand there at the start, who enters.
        self._entering: tuple[LateEntry, ...] = ()
        self._late: tuple[LateEntry, ...] = ()
        content = scene.additional.content
        if self._silent:
            content, late = late_entries(scene.additional)
            self._entering = tuple(e for e in late if e.name in self._convoy)
            self._late = tuple(e for e in late if e.name not in self._convoy)
        sim.load_scene(scene, content)

    def begin(self) -> None:
        """Hold the vehicles that wait for the ego."""
        for vehicle in self._there():
            self._sim.hold(vehicle)
        if self._silent and self._sim.is_there(WAITING_ID):
            self._sim.hold(WAITING_ID)

    def update(self, ego: EgoState) -> None:
        """Before a step: releases the road users that wait for the ego's new place."""
        if not (self._waits or self._silent):
            return
        to_line = self._approach.to_line(ego)
        if self._is_time(to_line, ego.speed):
            self._waits = False
            self._let_in(self._entering, self._sim.time())
            for entry in self._entering:
                # For good in their lane.
                self._sim.hold(entry.name)
            for vehicle in self._convoy:
                self._sim.release(vehicle, heeds_priority=not self._silent)
        if not self._silent:
            return
        if self._showing.may(to_line, ego.speed):
            self._speak()
        elif self._plan is not None and not self._waits:
            spare = self._spare(self._plan, to_line, ego.speed)
            late = spare < 0.0
            there = self._there()
            self._paces |= {name: self._sim.pace(name) for name in there if name not in self._paces}
            if late or self._hurries:
                for vehicle, (speed, accel) in self._paces.items():
                    # One that has hurried does not brake for that.
                    own = max(speed, self._sim.speed(vehicle)), accel
                    self._sim.set_pace(vehicle, *((MAX_SPEED_MPS, MAX_ACCEL_MPS2) if late else own))
            self._hurries = late
            lead = self._convoy[0]
            if lead in there:
                top, hold = math.inf, OLD_HOLD
                if self._plan.keeps_back:
                    hold = HOLD_BEFORE_LINE_M, HOLD_BRAKE_MPS2
                    if not late:
                        top = self._kept_back(self._plan, to_line, ego.speed)
                    if spare < EVEN_S:
                        top = max(top, self._sim.speed(lead))
                self._sim.stop_before_end(lead, *hold, top)

    def _is_time(self, to_line: float, speed: float) -> bool:
        """Is the convoy released at this tick?"""
        if self._release is None or self._plan is None or not self._waits:
            return False
        return self._release.update_at(to_line, speed) or (
            self._silent and self._spare(self._plan, to_line, speed) < 0.0
        )

    def _spare(self, plan: ConvoyPlan, to_line: float, speed: float) -> float:
        """Seconds that the convoy has in hand, if it and the ego do their utmost; below 0 it has to hurry now."""
        lead = self._convoy[0]
        if self._sim.is_there(lead):
            own_way, own_speed = self._sim.to_lane_end(lead), self._sim.speed(lead)
        else:
            first = self._entering[0]
            own_way, own_speed = self._sim.entry(first.vtype, first.edges[0], first.lane)
        own = earliest_arrival(own_way, own_speed, MAX_ACCEL_MPS2, MAX_SPEED_MPS)
        ego = earliest_arrival(to_line + plan.ego_zone_m, speed, MAX_ACCEL_MPS2, MAX_SPEED_MPS)
        return ego + min(plan.after_s, REACHED_AFTER_S) - own - DT_S

    def _kept_back(self, plan: ConvoyPlan, to_line: float, speed: float) -> float:
        """Speed (m/s) at which the convoy is at its own line when it should be, as the ego drives now.

        Of an ego that is slow near its line it is not expected that it speeds up.
        """
        way = to_line + plan.ego_zone_m
        eta = predicted_arrival(to_line, way, speed, plan.ego_cruise_mps, plan.ego_turn_mps)
        if to_line < NEAR_M:
            eta = max(eta, way / max(speed, WAITS_MPS))
        return max(self._sim.to_lane_end(self._convoy[0]) / (eta + KEEPS_BACK_S), LEAST_MPS)

    def _speak(self) -> None:
        """From now on all traffic does what the plates say; vehicles that would have entered by now enter."""
        self._silent = False
        for vehicle in self._convoy:
            self._sim.release(vehicle)
        if self._sim.is_there(WAITING_ID):
            self._sim.release(WAITING_ID)
        if self._late:
            self._let_in(self._late, max(self._sim.time() + DT_S, self._late[0].depart))

    def _there(self) -> list[str]:
        """The vehicles of the convoy that are on the road."""
        return [vehicle for vehicle in self._convoy if self._sim.is_there(vehicle)]

    def _let_in(self, cars: tuple[LateEntry, ...], at: float) -> None:
        """Let cars enter, the first at a time (s), the others as much later as their scene has it."""
        for car in cars:
            depart = round(car.depart + at - cars[0].depart, 1)
            self._sim.add_car(car.name, car.vtype, car.edges, car.lane, depart)
