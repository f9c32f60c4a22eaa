"""`plant2` as a planner: blind to signs, repeatable, and a controller that does what a plan says."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from learned_scenes import Recorder, with_signs
from training_helpers import fresh_blind, fresh_tuned, fresh_weights

from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.ablations import InSight, WithoutHalts, WithoutMemory
from tsbench.learn.plant2.plant2_network import Plant2Network
from tsbench.learn.plant2.plant2_planner import HOLD_TICKS, Gains, Plant2, Plant2Blind, Plant2Ft, StopPolicy, control
from tsbench.learn.plant2.sign_tokens import SignMemory, vocabulary_of
from tsbench.learn.plant2.tokens import PATH_POINTS, PLAN
from tsbench.planners import registry
from tsbench.planners.base import Control
from tsbench.planners.observation import SignView
from tsbench.sim.ego import Motion, advance
from tsbench.sim.world import EGO_LENGTH_M, EgoState

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where: Path = tmp_path_factory.mktemp("weights")
    kinds = (("plant2", Plant2Network), ("plant2-ft", fresh_tuned), ("plant2-blind", fresh_blind))
    for name, kind in kinds:
        fresh_weights(where, name, kind)
    return where


def commands(planner: Plant2, drive: Recorder, *, signs: bool) -> list[Control]:
    planner.reset(drive.context)
    return [planner.act(with_signs(o) if signs else o) for o in drive.seen]


def test_the_learned_floor_sees_posts_and_nothing_on_them(drive: Recorder, folder: Path) -> None:
    entry = registry.resolve("tsbench.learn.plant2.plant2_planner:Plant2Blind")
    assert (entry.floor, entry.sign_access, entry.privileged) == (True, False, False)
    planner = Plant2Blind(folder=folder)
    plates = [with_signs(o) for o in drive.seen]
    posts = [replace(o, signs=tuple(s.masked() for s in o.signs)) for o in plates]
    read = []
    for seen in (plates, posts, drive.seen):
        planner.reset(drive.context)
        read.append([planner.act(o) for o in seen])
    assert read[0] == read[1] != read[2]
    tokens = planner.encode(posts[0])[0]
    assert np.count_nonzero(tokens["sign_classes"]) == 3
    assert not tokens["held_classes"].any()


def straight_plans(count: int, speed: float, standing: float = 0.0, step_m: float = 1.0) -> np.ndarray:
    """As many answers of a network: straight ahead."""
    answer = np.zeros(count, dtype=PLAN)
    answer["path"][..., 0] = step_m * np.arange(1, PATH_POINTS + 1)
    answer["speed"], answer["standing"] = speed, standing
    return answer


def test_it_halts_where_it_may_have_to_stand_until_it_has_waited(drive: Recorder, folder: Path) -> None:
    planner, o = Plant2Ft(folder=folder), drive.seen[0]
    planner._stop_policy = StopPolicy(share=0.1, waits=5.0, rise=0.02)
    planner.reset(drive.context)
    plan = np.zeros(1, dtype=PLAN)[0]
    plan["speed"], plan["standing"] = 4.0, 0.3
    wishes = []
    for k in range(200):
        # Rolling a little does not end the wait.
        planner.act(replace(o, ego=replace(o.ego, speed=0.3 * (k % 2)), step=k))
        wishes.append(planner.target_speed(plan))
    assert wishes[140] == 0.0
    assert wishes[160] == 4.0
    planner.act(replace(o, step=200))
    assert planner.target_speed(plan) == 0.0


def test_one_plan_that_goes_does_not_end_a_halt(drive: Recorder, folder: Path) -> None:
    """A halt lasts `hold_s` = 0.6 s beyond the last plan that halts: six ticks at 10 Hz."""
    stands = iter([0.0, 0.0, 0.9, 0.0, 0.9, *[0.0] * 15])

    planner, o = Plant2Ft(lambda records: straight_plans(len(records), 4.0, next(stands))), drive.seen[0]
    planner._stop_policy = StopPolicy(share=0.1, hold_s=0.6)
    planner.reset(drive.context)
    halted = []
    for k in range(30):
        planner.act(replace(o, step=k))
        halted.append(planner.target_speed(planner._plan) == 0.0)
    # The fifth plan is made at tick 8 and followed at tick 9.
    assert halted == [False] * 4 + [True] * 11 + [False] * 15


def test_plant2_ft_tells_others_where_its_path_leads(drive: Recorder) -> None:
    """One plan of 20 m, one of 1 m: between two plans it tells what the last one told."""
    steps = iter([1.0, 0.05])
    planner = Plant2Ft(lambda records: straight_plans(len(records), 4.0, step_m=next(steps)))
    planner.reset(drive.context)
    asked = []

    def intent(x: float, y: float, ahead: float) -> tuple[str, ...]:
        asked.append((x, y, ahead))
        return ("a", "b") if ahead > 10.0 else ()

    planner._signs.ways.intent = intent  # type: ignore[method-assign]
    o = drive.seen[0]
    turned = replace(o.ego, heading=math.pi / 2)
    told = [planner.act(replace(o, ego=replace(turned), step=k)).intent for k in range(4)]
    assert told == [("a", "b"), ("a", "b"), (), ()]
    assert asked[0] == pytest.approx((turned.x, turned.y + 20.0, 20.0))
    assert len(asked) == 2


@pytest.mark.parametrize(("standing", "most"), [(0.9, -3.0), (0.0, 2.5)])
def test_a_halt_brakes_to_the_end(drive: Recorder, standing: float, most: float) -> None:
    """In proportion to half a metre a second it would brake by 0.75 m/s2, and roll on for decimetres."""

    planner, o = Plant2Ft(lambda records: straight_plans(len(records), 4.0, standing)), drive.seen[0]
    planner._stop_policy = StopPolicy(share=0.3, brakes=3.0)
    planner.reset(drive.context)
    slow = replace(o.ego, speed=0.5, acceleration=0.0)
    # The first tick makes a plan, the second follows it.
    assert [planner.act(replace(o, ego=slow, step=k)).acceleration for k in (0, 1)] == [most, most]
    fast = planner.act(replace(o, ego=replace(slow, speed=8.0), step=2)).acceleration
    assert fast == pytest.approx(-6.0)


def test_between_two_plans_the_last_one_is_followed_from_where_the_ego_is(drive: Recorder, folder: Path) -> None:
    """A plan of a straight line at the ego's speed: no command swings, whenever it was made."""
    asked = []

    def infer(records: np.ndarray) -> np.ndarray:
        asked.append(len(records))
        return straight_plans(len(records), drive.seen[0].ego.speed)

    planner = Plant2(infer)
    planner.reset(drive.context)
    ahead = [o for o in drive.seen if abs(o.ego.yaw_rate) < 1e-6][:10]
    given = [planner.act(o) for o in ahead]
    assert sum(asked) == len(ahead) / HOLD_TICKS
    assert all(abs(c.steering) < 1e-6 and abs(c.acceleration) < 1e-6 for c in given)
    beside = replace(ahead[1], ego=replace(ahead[1].ego, heading=ahead[1].ego.heading + 0.1))
    planner.act(ahead[0])
    assert planner.act(beside).steering < -0.05


def test_the_fine_tuned_one_heeds_signs_and_what_held_before(drive: Recorder, folder: Path) -> None:
    planner = Plant2Ft(folder=folder)
    blind = commands(planner, drive, signs=False)
    assert commands(planner, drive, signs=True) != blind
    assert commands(planner, drive, signs=False) == blind


def straight(offset: float = 0.0, turn: float = 0.0) -> np.ndarray:
    at = np.arange(1.0, 21.0)
    return np.column_stack((at * math.cos(turn), at * math.sin(turn) + offset))


def ego(speed: float) -> EgoState:
    return EgoState(0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0, 0.0, 0.0, True)


def test_control_brakes_speeds_up_and_steers_to_the_right_side() -> None:
    gains = Gains()
    assert control(straight(), 10.0, ego(5.0), gains).acceleration == gains.most
    assert control(straight(), 2.0, ego(10.0), gains).acceleration == gains.least
    assert control(straight(), 8.0, ego(8.0), gains).acceleration == pytest.approx(0.0)
    assert control(straight(0.5), 8.0, ego(8.0), gains).steering > 0.0
    assert control(straight(-0.5), 8.0, ego(8.0), gains).steering < 0.0


def test_a_wish_below_walking_is_a_halt() -> None:
    gains = Gains()
    state = Motion(0.0, 0.0, 0.0, 1.5)
    for _ in range(60):
        here = EgoState(0.0, 0.0, 0.0, state.speed, state.acceleration, 0.0, 0.0, 0, 0.0, 0.0, True)
        state = advance(state, control(straight(), 0.3, here, gains).acceleration, 0.0)
    assert state.speed < 0.01


@pytest.mark.parametrize("speed", [2.0, 8.0, 14.0])
def test_control_comes_back_to_a_line_without_swinging(speed: float) -> None:
    m = Motion(0.0, 1.0, math.radians(5.0), speed)
    sides = []
    for _ in range(round(60.0 / speed / 0.1)):
        points = np.column_stack((m.x + np.arange(1.0, 21.0), np.zeros(20)))
        c, s = math.cos(m.heading), math.sin(m.heading)
        seen = (points - (m.x, m.y)) @ np.array([[c, -s], [s, c]])
        here = EgoState(m.x, m.y, m.heading, m.speed, m.acceleration, m.steering, m.yaw_rate, 0, 0.0, 0.0, True)
        command = control(seen, speed, here, Gains())
        m = advance(m, command.acceleration, command.steering)
        sides.append(m.y)
    assert abs(sides[-1]) < 0.05
    assert min(sides) > -0.3


def plan_that_stands() -> np.void:
    plan = np.zeros(1, dtype=at.PLAN)[0]
    plan["speed"], plan["standing"] = 1.5, 0.9
    return plan


def test_without_halts_it_drives_at_the_mean_speed(drive: Recorder) -> None:
    whole, bare = Plant2Ft(), WithoutHalts()
    for planner in (whole, bare):
        planner.reset(drive.context)
    assert whole.target_speed(plan_that_stands()) == 0.0
    assert bare.target_speed(plan_that_stands()) == 1.5


def test_without_memory_a_plate_out_of_sight_is_gone_and_a_stop_forgotten(drive: Recorder) -> None:
    o = drive.seen[0]
    line = next(piece.s1 for piece in o.route.path.pieces if o.route.s <= piece.s1)
    before_line = replace(o.route, s=line - 2.0 - EGO_LENGTH_M / 2)
    x, y, heading = (o.ego.x + 2.0 * np.cos(o.ego.heading), o.ego.y + 2.0 * np.sin(o.ego.heading), o.ego.heading)
    stop = SignView("2.5", None, x, y, heading, o.route.path.edges[0], -1, 0.0, 2.0)
    stands = replace(o, route=before_line, ego=replace(o.ego, speed=0.0), signs=(stop,))
    words = vocabulary_of()
    told = []
    for kind in (SignMemory, InSight):
        memory, rows = kind(drive.context.network, words), np.zeros(2, dtype=at.SIGN_TOKENS)
        for row, seen in zip(rows, (stands, replace(stands, step=o.step + 1, signs=())), strict=True):
            memory.update(seen)
            memory.fill(row, seen, 0)
        told.append([(bool(row["held_classes"][0]), float(row["held"][0, -1])) for row in rows])
    assert told == [[(True, 1.0), (True, 1.0)], [(True, 0.0), (False, 0.0)]]
    planner = WithoutMemory()
    planner.reset(drive.context)
    assert isinstance(planner._signs._memory, InSight)
