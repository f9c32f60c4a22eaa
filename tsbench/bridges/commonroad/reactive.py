"""CommonRoad's reactive planner (TU Munich, BSD), asked twice a second in a scenario made of what is seen.

The planner is its authors': samples in a Frenet frame (Werling et al., ICRA 2010), cost function, checks of kinematics
and collisions. It takes a way and a desired speed and reads no plates itself. The speed is what commonroad-io's own
`TrafficSignInterpreter` makes of the plates, so it reads limits and minimum speeds (numbers 274 and 275) and no others.
Units: m, m/s, rad.
"""

from __future__ import annotations

import logging
import math
from typing import Any, ClassVar

import commonroad_dc.pycrcc as collision
import numpy as np
from commonroad.common.util import Interval
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.state import CustomState
from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry
from commonroad.scenario.traffic_sign_interpreter import TrafficSignInterpreter
from commonroad_clcs.pycrccosy import (
    CurvilinearProjectionDomainLateralError,
    CurvilinearProjectionDomainLongitudinalError,
)
from commonroad_dc.collision.collision_detection.pycrcc_collision_dispatch import create_collision_object
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.state import ReactivePlannerState
from commonroad_rp.utility.config import (
    DebugConfiguration,
    PlanningConfiguration,
    ReactivePlannerConfiguration,
    SamplingConfiguration,
    VehicleConfiguration,
)
from commonroad_rp.utility.utils_coordinate_system import create_coordinate_system

from tsbench.bridges.commonroad.scenario import LiveScenario, state_of, walls
from tsbench.geometry.elementary import wrap
from tsbench.geometry.polyline import Array, Polyline
from tsbench.planners.base import PlannerContext, Trajectory
from tsbench.planners.geometry import EGO, RouteLine, route_line
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import RoutePath
from tsbench.sim.world import EgoState

# Ticks from one question to the next: 2 Hz, as in the planner's own examples. Its horizon, in time steps.
EVERY = 5
STEPS = 40
# So long it waits before it asks again where it stands and nothing was found.
PATIENCE = 30
# How it brakes for a slower stretch ahead, and how fast it goes round a bend.
_EASY_MPS2 = 2.0
_SIDEWAYS_MPS2 = 2.0
_LOOK_M = 60.0
_STEP_M = 2.0
# The piece of the way that is its reference: a long one that bends back leaves no room beside it. Made anew so often.
_BACK_M, _FORTH_M, _ANEW_M = 10.0, 90.0, 15.0
# Samples of speed end this much above the ego's. The planner tries two of its three levels of density.
_FASTER_MPS = 4.0
_LEVELS = 3
_STILL_MPS = 0.05
_REAR_M = EGO.wheelbase / 2


class Reactive:
    """`tsbench.bridges.commonroad:Reactive`."""

    sign_access: ClassVar[bool] = True

    def __init__(self) -> None:
        logging.getLogger("RP_LOGGER").setLevel(logging.CRITICAL)
        self._config = _configuration()
        self._context: PlannerContext
        self._live: LiveScenario
        self._walls: Any
        self._planner: Any
        self._network: Any
        self._path: RoutePath | None
        self._line: RouteLine
        self._frame: Any
        self._framed: float
        self._bends: Array
        self._asked: int
        self._found = True
        self._times: Array
        self._poses: Array

    def reset(self, context: PlannerContext) -> None:
        self._context = context
        self._live = LiveScenario(context)
        self._walls = walls(context.network)
        self._planner, self._network, self._path = None, None, None
        self._asked, self._found = -EVERY, True

    def act(self, observation: Observation) -> Trajectory:
        """Ask, where it is time, and follow the answer."""
        o = observation
        fresh = o.route.path is not self._path
        if fresh:
            self._path, self._line = o.route.path, route_line(self._context, o, past=_FORTH_M)
            self._framed = -math.inf
            self._bends = _bend_speeds(self._line.line)
        if fresh or o.step - self._asked >= (EVERY if self._found else PATIENCE):
            self._asked = o.step
            self._times, self._poses = self._ask(o)
        left = self._times - o.time
        ahead = left > 1e-3
        return Trajectory(left[ahead], self._poses[ahead])

    def _ask(self, o: Observation) -> tuple[Array, Array]:
        """(times of the episode (k,), poses of the centre (k, 3))."""
        s = self._line.start + o.route.s
        if s > self._framed + _ANEW_M:
            self._framed = s
            piece = self._line.line.slice(s - _BACK_M, s + _FORTH_M)
            self._frame = _Frame(create_coordinate_system(piece.resampled(_STEP_M).points))
        if abs(wrap(o.ego.heading - self._line.line.heading_at(s))) > math.pi / 2:
            # Navigation says to turn round, which the planner refuses to be asked.
            return self._stop(o)
        scenario = self._live.scenario(o, STEPS)
        speed = self._desired(o, scenario.lanelet_network)
        self._config.update(scenario=scenario, planning_problem=_problem(o, speed))
        if self._planner is None or self._network is not scenario.lanelet_network:
            # It keeps the ids of the lanelets that it was made with.
            self._planner, self._network = ReactivePlanner(self._config), scenario.lanelet_network
        self._planner.reset(
            config=self._config,
            initial_state_cart=self._state(o.ego),
            collision_checker=self._checker(scenario),
            coordinate_system=self._frame,
        )
        self._planner.set_desired_velocity(desired_velocity=speed, current_speed=o.ego.speed)
        self._planner.set_v_sampling_parameters(0.0, min(speed, o.ego.speed + _FASTER_MPS))
        found = self._plan(o.ego)
        self._found = found is not None or o.ego.speed > _STILL_MPS
        if found is None:
            return self._stop(o)
        states = found[0].state_list[1:]
        poses = np.array([(*one.position, one.orientation) for one in states])
        poses[:, :2] += _REAR_M * np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
        times = np.asarray(o.time + self._context.dt * np.arange(1, len(poses) + 1), dtype=np.float64)
        return times, poses

    def _plan(self, ego: EgoState) -> Any:
        try:
            return self._planner.plan()
        except TypeError:
            # Version 2025.1 fails to word its own message where the ego stands and no sample is left.
            if ego.speed > _STILL_MPS:
                raise
            return None

    def _stop(self, o: Observation) -> tuple[Array, Array]:
        """The planner has found nothing: full brakes on a line beside the route's."""
        t = self._context.dt * np.arange(1, STEPS + 1)
        braking = np.minimum(t, o.ego.speed / EGO.braking)
        ways = o.ego.speed * braking - EGO.braking * braking**2 / 2
        line, s = self._line.line, self._line.start + o.route.s
        rows = [(*line.point_at(s + way, o.route.d), line.heading_at(s + way)) for way in ways.tolist()]
        times = np.asarray(o.time + t, dtype=np.float64)
        return times, np.array(rows)

    def _state(self, ego: EgoState) -> Any:
        """The ego as the planner has it: at the middle of its rear axle."""
        back = np.array([math.cos(ego.heading), math.sin(ego.heading)]) * _REAR_M
        steering = ego.steering
        if ego.speed < _STILL_MPS:
            # A standing vehicle can turn the wheels before it drives off; the planner takes them as they are.
            s = self._frame.convert_to_curvilinear_coords(*(np.array([ego.x, ego.y]) - back))[0]
            steering = math.atan(EGO.wheelbase * float(np.interp(s, self._frame.ref_pos, self._frame.ref_curv)))
        place = np.array([ego.x, ego.y]) - back
        moving = {"velocity": ego.speed, "acceleration": ego.acceleration, "yaw_rate": ego.yaw_rate}
        return ReactivePlannerState(
            time_step=0, position=place, orientation=ego.heading, steering_angle=steering, **moving
        )

    def _desired(self, o: Observation, network: Any) -> float:
        """The speed to go at: what plates, roads and bends ahead let it have, if it brakes for them at ease."""
        plates = TrafficSignInterpreter(SupportedTrafficSignCountry.ZAMUNDA, network)
        path, best = o.route.path, EGO.top_speed
        for ahead in np.arange(0.0, _LOOK_M, _STEP_M).tolist():
            s = o.route.s + ahead
            lane = path.lane_at(s)
            lanelet = self._live.lanelet_at(
                lane, self._context.network.lanes[lane].line.project(*path.line.point_at(s))[0]
            )
            here = frozenset() if lanelet is None else frozenset({lanelet})
            limit = plates.speed_limit(here) or path.limit_at(s)
            least = 0.0 if ahead else plates.required_speed(here) or 0.0
            k = min(int((self._line.start + s) / _STEP_M), len(self._bends) - 1)
            allowed = min(max(limit, least), float(self._bends[k]))
            best = min(best, math.sqrt(allowed**2 + 2 * _EASY_MPS2 * ahead))
        return best

    def _checker(self, scenario: Any) -> Any:
        checker = collision.CollisionChecker()
        for one in (*scenario.static_obstacles, *scenario.dynamic_obstacles):
            checker.add_collision_object(create_collision_object(one))
        checker.add_collision_object(self._walls)
        return checker


class _Frame:
    """A coordinate system as the planner asks for one: no point, and no exception, for what lies outside.

    The planner's version 2025.1 was made for a commonroad-clcs that answered so; that of 2025.2 raises.
    """

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def convert_to_cartesian_coords(self, s: float, d: float) -> Array | None:
        try:
            found: Array = self._inner.convert_to_cartesian_coords(s, d)
        except (CurvilinearProjectionDomainLateralError, CurvilinearProjectionDomainLongitudinalError):
            return None
        return found


def _configuration() -> Any:
    """The planner's defaults, for tsbench's ego, in one process, with a horizon of 4 s."""
    axle = EGO.wheelbase / 2
    turns = {
        "delta_min": -EGO.steering,
        "delta_max": EGO.steering,
        "v_delta_min": -EGO.steering_rate,
        "v_delta_max": EGO.steering_rate,
    }
    vehicle = VehicleConfiguration(
        length=EGO.length, width=EGO.width, wb_front_axle=axle, wb_rear_axle=axle, a_max=EGO.braking, **turns
    )
    return ReactivePlannerConfiguration(
        vehicle=vehicle,
        planning=PlanningConfiguration(time_steps_computation=STEPS, replanning_frequency=EVERY),
        sampling=SamplingConfiguration(num_sampling_levels=_LEVELS),
        debug=DebugConfiguration(multiproc=False, logging_level="CRITICAL"),
    )


def _problem(o: Observation, speed: float) -> Any:
    """From where the ego is, at that speed. The planner takes nothing else from a goal; where to go, its way says."""
    ego = o.ego
    start = state_of(ego.x, ego.y, ego.heading, ego.speed, ego.acceleration, ego.yaw_rate)
    goal = CustomState(time_step=Interval(0, STEPS), velocity=Interval(speed, speed))
    return PlanningProblem(1, start, GoalRegion([goal]))


def _bend_speeds(line: Polyline) -> Array:
    """(k,) the speed to take each `_STEP_M` of a line with: 2 m/s2 sideways, over 6 m of it."""
    at = np.arange(0.0, line.length, _STEP_M)
    headings = np.unwrap([line.heading_at(s) for s in at.tolist()])
    ends = np.minimum(np.arange(len(at)) + 2, len(at) - 1)
    begins = np.maximum(np.arange(len(at)) - 1, 0)
    curvature = np.abs(headings[ends] - headings[begins]) / (_STEP_M * np.maximum(ends - begins, 1))
    speeds: Array = np.sqrt(_SIDEWAYS_MPS2 / np.maximum(curvature, 1e-3))
    return speeds
