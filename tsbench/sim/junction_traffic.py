"""Everybody but the ego at a junction whose plates could be exchanged: they tell nothing until it is too late.

Who has priority is seen in what others do. So until the ego waits at its line, or could no longer stop before it meets
the convoy, however late that is, SUMO's right of way moves nobody: the convoy comes as the release says and stops
before its own line, who waits on another arm waits on, and who would enter the scene enters later. An ego that rushes,
to be through before the convoy comes, meets it all the same: the convoy hurries.
Source: docs/spec/scenes.md, "Junction". Units: m, s.
"""

from __future__ import annotations

from tsbench.signs.contrast import PassageParams
from tsbench.signs.plate_params import GiveWayParams, RoundaboutParams
from tsbench.sim.convoy import (
    RUSHED_AFTER_S,
    Approach,
    ConvoyRelease,
    Showing,
    rushed_arrival,
    speed_to_meet,
)
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_SPEED_MPS
from tsbench.sim.scene import ConvoyPlan, Scene
from tsbench.sim.scene_file import WAITING_ID, LateEntry, late_entries
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState

# The first of a convoy stands so far before its own line at the latest, and brakes no harder than this for it: less
# than what the rule of giving way takes for forced (sign_catalog/rules/give_way.yaml).
HOLD_BEFORE_LINE_M = 3.0
HOLD_BRAKE_MPS2 = 2.0


def exchangeable(scene: Scene) -> bool:
    """Do plates of this scene say who has priority at a junction, in one half of a pair so and in the other not?"""
    params = scene.target_sign.params
    if isinstance(params, GiveWayParams) and not isinstance(params, RoundaboutParams):
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
        self._approach = (
            self._release.approach if self._release else Approach(scene.network.lane(scene.start.lane))
        )
        self._showing = self._release.showing if self._release else Showing()
        self._silent = exchangeable(scene)
        self._waits = self._release is not None
        # What the convoy speeds up to.
        self._pace = 0.0
        self._late: tuple[LateEntry, ...] = ()
        content = scene.additional.content
        if self._silent:
            content, self._late = late_entries(scene.additional)
        sim.load_scene(scene, content)

    def begin(self) -> None:
        """Hold who waits for the ego."""
        for vehicle in self._convoy:
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
            self._pace = self._sim.top_speed(self._convoy[0])
            for vehicle in self._convoy:
                self._sim.release(vehicle, heeds_priority=not self._silent)
        if not self._silent:
            return
        if self._showing.may(to_line, ego.speed):
            self._speak()
        elif self._plan is not None and not self._waits:
            self._hurry(self._plan, to_line, ego.speed)
            self._sim.stop_before_end(self._convoy[0], HOLD_BEFORE_LINE_M, HOLD_BRAKE_MPS2)

    def _is_time(self, to_line: float, speed: float) -> bool:
        """Is the convoy released at this tick? For an ego that rushes where plates could be exchanged it is sooner."""
        if self._release is None or self._plan is None or not self._waits:
            return False
        if self._release.update_at(to_line, speed):
            return True
        arrival = rushed_arrival(self._plan, to_line, speed) if self._silent else None
        return arrival is not None and arrival + _behind_s(self._plan) <= self._plan.lead_time_s

    def _hurry(self, plan: ConvoyPlan, to_line: float, speed: float) -> None:
        """The convoy is no farther behind an ego that rushes than behind one that does not."""
        arrival = rushed_arrival(plan, to_line, speed)
        if arrival is None:
            return
        room, own = self._sim.to_lane_end(self._convoy[0]), self._sim.speed(self._convoy[0])
        pace = min(speed_to_meet(room, arrival + _behind_s(plan), own, MAX_ACCEL_MPS2), MAX_SPEED_MPS)
        if pace > self._pace:
            self._pace = pace
            for vehicle in self._convoy:
                self._sim.hurry(vehicle, pace, MAX_ACCEL_MPS2)

    def _speak(self) -> None:
        """From now everybody does what the plates say; who would have entered by now enters from now on."""
        self._silent = False
        for vehicle in self._convoy:
            self._sim.release(vehicle)
        if self._sim.is_there(WAITING_ID):
            self._sim.release(WAITING_ID)
        if self._late:
            delay = max(self._sim.time() + DT_S - self._late[0].depart, 0.0)
            for car in self._late:
                self._sim.add_car(car.name, car.vtype, car.edges, car.lane, round(car.depart + delay, 1))


def _behind_s(plan: ConvoyPlan) -> float:
    """So long after an ego that rushes is in the zone the convoy is to be at its own line."""
    return min(plan.after_s, RUSHED_AFTER_S)
