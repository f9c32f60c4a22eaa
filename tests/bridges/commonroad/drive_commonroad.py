"""Run by test_commonroad in a process of its own, whose protobuf is CommonRoad's: drives scenes, prints JSON."""

from __future__ import annotations

import json
import math
import warnings

import commonroad_dc.pycrcc as collision
import numpy as np
from commonroad.scenario.traffic_sign import SupportedTrafficSignCountry
from commonroad.scenario.traffic_sign_interpreter import TrafficSignInterpreter

from tsbench.bridges.commonroad import LiveScenario, Reactive
from tsbench.bridges.commonroad.scenario import forecast, walls
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.base import PlannerContext, Trajectory
from tsbench.planners.observation import Observation, SignView
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

warnings.simplefilter("ignore")
FIVE = (
    ("speed_limit", False),
    ("speed_limit", True),
    ("min_speed", False),
    ("detour_right", False),
    ("no_turn_left", True),
)


class Watched(Reactive):
    """The planner, and what it was shown."""

    context: PlannerContext
    seen: list[Observation]
    answers: list[Trajectory]

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        Watched.context, Watched.seen, Watched.answers = context, [], []

    def act(self, observation: Observation) -> Trajectory:
        answer = super().act(observation)
        Watched.seen.append(observation)
        Watched.answers.append(answer)
        return answer


def row(kind: str, contrast: bool) -> ScenarioSpec:
    rows = DataSet().table("dev")
    return next(r for r in rows if r.scenario_type == kind and (r.half == CONTRAST) == contrast)


def told(o: Observation) -> dict[str, object]:
    """What a scenario says of a moment of the last drive."""
    roads = Watched.context.network
    live = LiveScenario(Watched.context)
    scenario = live.scenario(o, 30)
    network = scenario.lanelet_network
    by_lane = {lane.index: live.lanelet_at(lane.index, lane.line.length / 2) for lane in roads.lanes}
    lanelets = {lanelet.lanelet_id: lanelet for lanelet in network.lanelets}
    interpreter = TrafficSignInterpreter(SupportedTrafficSignCountry.ZAMUNDA, network)
    plates = []
    for sign in o.signs:
        lane = roads.lanes[roads.edges[sign.edge].lanes[max(sign.lane, 0)]]
        before, behind = (live.lanelet_at(lane.index, sign.position_m + d) for d in (-2.0, 2.0))
        plates.append([sign.code, sign.value, *(interpreter.speed_limit(frozenset({one})) for one in (before, behind))])
    ways = {(c.from_lane, c.via[0]) for c in roads.connections if c.via and by_lane[c.via[0]]}
    return {
        "lanes": sum(one is not None for one in by_lane.values()),
        "lanelets": len(lanelets),
        "dangling": sum(
            other not in lanelets for one in lanelets.values() for other in one.successor + one.predecessor
        ),
        "unfollowed": sum(by_lane[b] not in _last(live, roads.lanes[a], lanelets).successor for a, b in ways),
        "plates": plates,
        "road_users": [len(o.actors), len(scenario.dynamic_obstacles)],
        "obstacles": [len(o.obstacles), len(scenario.static_obstacles)],
        "forecast_steps": sorted({one.prediction.final_time_step for one in scenario.dynamic_obstacles}),
        "same_network": network is live.scenario(o, 30).lanelet_network,
    }


def _last(live: LiveScenario, lane: object, lanelets: dict[int, object]) -> object:
    return lanelets[live.lanelet_at(lane.index, lane.line.length)]


def edges() -> dict[str, bool]:
    """Does the edge of the road touch a car in the middle of a lane, in a junction, and half beside the road?"""
    roads = Watched.context.network
    checker = collision.CollisionChecker()
    checker.add_collision_object(walls(roads))

    def touched(lane: object, s: float, d: float) -> bool:
        x, y = lane.line.point_at(s, d)
        half = EGO_LENGTH_M / 2, EGO_WIDTH_M / 2
        return bool(checker.collide(collision.RectOBB(*half, lane.line.heading_at(s), x, y)))

    long = [lane for lane in roads.lanes if not lane.internal and lane.line.length > 20.0]
    inner = [lane for lane in roads.lanes if lane.internal and lane.line.length > 8.0]
    kerb = [roads.lanes[edge.lanes[0]] for edge in roads.edges.values() if edge.length > 20.0]
    return {
        "in a lane": any(touched(lane, lane.line.length / 2, 0.0) for lane in long),
        "in a junction": not inner or any(touched(lane, lane.line.length / 2, 0.0) for lane in inner),
        "beside the road": all(touched(lane, lane.line.length / 2, roads.to_kerb * lane.width / 2) for lane in kerb),
    }


def ways() -> dict[str, object]:
    """Forecasts of somebody on the longest lane with a way on, of one across it, and of one beside all roads."""
    roads = Watched.context.network
    lane = max((lane for lane in roads.lanes if not lane.internal), key=lambda lane: lane.line.length)
    s = lane.line.length - 10.0
    x, y = lane.line.point_at(s, 0.5)
    along = lane.line.heading_at(s)
    followed = forecast(roads, lane.index, (x, y, along), 0.5, 10)
    across = forecast(roads, lane.index, (x, y, along + math.pi / 2), 0.5, 10)
    alone = forecast(roads, -1, (x, y, along), 0.5, 10)
    offsets = [lane.line.project(*pose[:2]) for pose in followed.tolist()]
    return {
        "follows": np.allclose(offsets, [(s + 0.5 * k, 0.5) for k in range(1, 11)], atol=1e-6),
        "across": np.allclose(
            across[:, :2], [(x - 0.5 * k * math.sin(along), y + 0.5 * k * math.cos(along)) for k in range(1, 11)]
        ),
        "alone": np.allclose(np.hypot(alone[:, 0] - x, alone[:, 1] - y), 0.5 * np.arange(1, 11)),
    }


def masked() -> int:
    """How many plates a scenario has whose plates are all masked."""
    o = Watched.seen[0]
    hidden = tuple(SignView.masked(sign) for sign in o.signs)
    blind = Observation(o.step, o.time, o.ego, o.history, o.route, o.actors, hidden, o.obstacles)
    return len(LiveScenario(Watched.context).scenario(blind, 5).lanelet_network.traffic_signs)


def main() -> None:
    """JSON on the standard output."""
    runner = EpisodeRunner(LoadedPlanner("reactive", Watched))
    driven, said = [], []
    for kind, contrast in FIVE:
        result = runner.run(row(kind, contrast))
        speeds = [o.ego.speed for o in Watched.seen]
        asked = [float(answer.times[-1]) for answer in Watched.answers]
        driven.append(
            {
                "kind": kind,
                "outcome": str(result.outcome),
                "error": result.error,
                "fastest": max(speeds),
                "horizon": max(asked),
            }
        )
        said.append(told(Watched.seen[0]))
        if len(said) == 1:
            end = next(o for o in Watched.seen if any(sign.code == "3.25" for sign in o.signs))
            ended = told(end)["plates"]
    # The last of the five has a junction.
    roads = {"edges": edges(), "ways": ways(), "masked": masked()}
    again = runner.run(row(*FIVE[0]))
    first = runner.run(row(*FIVE[0]))
    runner.close()
    same = again.commands.tobytes() == first.commands.tobytes()
    print(json.dumps({"driven": driven, "told": said, "ended": ended, "same": same, **roads}))


main()
