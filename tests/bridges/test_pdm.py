"""The proposal planner: what it prefers, what it will not do, and that it drives."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from learned_scenes import Recorder

from tsbench.bridges.nuplan import TrackedObjectType
from tsbench.bridges.nuplan.nuplan_map import NuPlanMap
from tsbench.bridges.nuplan.states import Agent, OrientedBox, SceneObjectMetadata, StateSE2, StateVector2D
from tsbench.bridges.pdm import Pdm, forecast, score
from tsbench.bridges.pdm_proposals import OFFSETS_M, SHARES, STEPS, Centerline, Proposals, Route, roll_out, stop
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import CONTRAST

LENGTH, WIDTH = 4.6, 1.8


@pytest.fixture(scope="module")
def line(drive: Recorder) -> Centerline:
    ego, roads = drive.seen[0].ego, NuPlanMap(drive.context.network)
    told = SimpleNamespace(map_api=roads, route_roadblock_ids=roads.route_ids(drive.seen[0].route.path.edges))
    return Route(told).line(ego.x, ego.y, ego.heading)


def car(line: Centerline, s: float, d: float = 0.0, speed: float = 0.0, kind: str = "VEHICLE") -> Agent:
    x, y, heading = (float(part[0]) for part in line.place(np.array([s]), np.array([d])))
    velocity = StateVector2D(speed * np.cos(heading), speed * np.sin(heading))
    box = OrientedBox(StateSE2(x, y, heading), LENGTH, WIDTH, 1.5)
    return Agent(TrackedObjectType[kind], box, SceneObjectMetadata(0, "1", 1, "1", ""), velocity)


def judge(
    line: Centerline, things: list[Agent], s: float = 15.0, speed: float = 8.0
) -> tuple[Proposals, np.ndarray, np.ndarray]:
    x, y, heading = (float(part[0]) for part in line.place(np.array([s]), np.array([0.0])))
    others = forecast(line, StateSE2(x, y, heading), SimpleNamespace(tracked_objects=things))
    ways = roll_out(line, s, 0.0, speed, others, LENGTH, WIDTH)
    return ways, *score(line, ways, others, LENGTH, WIDTH)


def test_fifteen_proposals_by_speed_and_offset(line: Centerline) -> None:
    ways, scores, first = judge(line, [])
    assert ways.s.shape == (len(SHARES) * len(OFFSETS_M), STEPS + 1) == (15, 21)
    assert np.all(np.diff(ways.s, axis=1) >= 0.0)
    reached = ways.s[:, -1].reshape(len(SHARES), -1)
    assert np.all(np.diff(reached, axis=0) > 0.0)
    assert np.all(np.abs(ways.d[-3:, -1] - OFFSETS_M) < 0.3)
    assert np.isinf(first).all()
    # A free road: the fastest in the middle of the lane.
    assert int(np.argmax(scores)) == 13


def test_who_stands_ahead_is_stopped_for(line: Centerline) -> None:
    ways, scores, _ = judge(line, [car(line, 45.0)])
    best = int(np.argmax(scores))
    assert ways.s[best].max() < 45.0 - LENGTH
    free, _, _ = judge(line, [])
    assert ways.s[best, -1] < free.s[13, -1] - 3.0


def test_a_collision_that_cannot_be_driven_out_of_scores_nothing(line: Centerline) -> None:
    _, scores, first = judge(line, [car(line, 22.0)], speed=14.0)
    assert scores.max() == 0.0
    assert first.max() < 1.0


def test_who_comes_from_behind_is_at_fault_itself(line: Centerline) -> None:
    _, scores, first = judge(line, [car(line, 8.5, speed=14.0)])
    assert np.isinf(first).all()
    # Once it is past, the gap to it is short, and braking for it costs comfort, a sixth.
    assert scores.max() > 0.8


def test_a_fixed_thing_counts_half_a_collision(line: Centerline) -> None:
    _, moving, _ = judge(line, [car(line, 22.0)], speed=14.0)
    _, still, _ = judge(line, [car(line, 22.0, kind="BARRIER")], speed=14.0)
    assert moving.max() == 0.0
    assert 0.0 < still.max() <= 0.5


def test_it_stays_on_its_side_of_the_road(line: Centerline) -> None:
    _, scores, _ = judge(line, [])
    by_offset = scores.reshape(len(SHARES), -1)
    # One lane of 3.2 m: a metre to either side leads over its edge.
    assert line.left[0] < 2.0
    assert np.all(by_offset[-1, [0, 2]] == 0.0)


def test_it_slows_down_before_a_bend(line: Centerline) -> None:
    assert np.all(line.limit > 0.0)
    bent = Centerline(
        np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]]), np.array([0.0, 50.0, 100.0]), np.array([0.0, np.pi / 2]),
        np.array([[1.0, 0.0], [0.0, 1.0]]), np.full(2, 1.6), np.full(2, 1.6), np.array([14.0, 14.0]), 100.0,
    )  # fmt: skip
    assert bent.limit[0] == 14.0
    _, y, heading = bent.place(np.array([60.0]), np.array([1.0]))
    assert (float(y[0]), float(heading[0])) == (10.0, np.pi / 2)


def test_full_stop(line: Centerline) -> None:
    ways = stop(line, 15.0, 0.0, 12.0)
    assert ways.s[0, -1] - 15.0 == pytest.approx(12.0**2 / 12.0)
    assert ways.speed[0, -1] == pytest.approx(0.0)


FIVE = ("speed_limit", "no_turn_left", "yield", "crosswalk", "one_way_right")


def test_it_drives_five_scenes_and_the_same_twice() -> None:
    rows = [row for row in DataSet().table("dev") if row.half == CONTRAST]
    five = [next(row for row in rows if row.pair_type == kind) for kind in FIVE]
    runner = EpisodeRunner(LoadedPlanner("pdm", Pdm))
    driven = [runner.run(row) for row in five]
    again = runner.run(five[1])
    runner.close()
    assert not [result.error for result in driven if result.error]
    assert sum(result.outcome == "arrived" for result in driven) >= 4, [r.outcome for r in driven]
    assert driven[1].outcome == "arrived"
    assert driven[1].commands.tobytes() == again.commands.tobytes()
