"""The reward: the way counts once, and each soft penalty cuts it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from learned_scenes import record

from tsbench.episode.outcome import Outcome
from tsbench.learn.envs.reward import RewardSpec, RouteReward
from tsbench.planners.observation import Observation

SPEC = RewardSpec()


@pytest.fixture(scope="module")
def seen() -> list[Observation]:
    """Behind a leader who drives as fast."""
    return record().seen


def earned(o: Observation, after: Observation) -> float:
    return RouteReward(o, SPEC).tick(after)


def test_the_whole_way_is_worth_one(seen: list[Observation]) -> None:
    reward = RouteReward(seen[0], SPEC)
    total = sum(reward.tick(o) for o in seen[1:])
    share = 1.0 - seen[-1].route.remaining / seen[0].route.remaining
    assert total == pytest.approx(share)
    assert total + reward.end(Outcome.ARRIVED) == pytest.approx(1.0)


def test_way_that_was_lost_is_not_earned_twice(seen: list[Observation]) -> None:
    reward = RouteReward(seen[0], SPEC)
    assert reward.tick(seen[9]) > 0.0
    assert reward.tick(seen[2]) == 0.0
    assert reward.tick(seen[8]) == 0.0
    assert reward.tick(seen[10]) > 0.0
    lost = replace(seen[11], route=replace(seen[11].route, remaining=float("inf")))
    assert reward.tick(lost) == 0.0


@pytest.mark.parametrize("worse", [{"speed": 30.0}, {"yaw_rate": 0.9}, {"acceleration": -6.0}])
def test_bad_manners_are_cut(seen: list[Observation], worse: dict[str, float]) -> None:
    before, after = seen[4], seen[5]
    spoilt = replace(after, ego=replace(after.ego, **worse))
    assert earned(before, spoilt) < 0.9 * earned(before, after)
    assert earned(before, spoilt) > 0.0


def test_beside_the_route_and_close_behind_are_cut(seen: list[Observation]) -> None:
    before, after = seen[4], seen[5]
    beside = replace(after, route=replace(after.route, d=2.5))
    assert earned(before, beside) == pytest.approx(SPEC.least * earned(before, after))
    standing = replace(after, actors=replace(after.actors, speed=np.zeros(len(after.actors))))
    assert earned(before, standing) < 0.95 * earned(before, after)


def test_infractions_cost(seen: list[Observation]) -> None:
    reward = RouteReward(seen[0], SPEC)
    for failure in (Outcome.COLLISION, Outcome.OFF_ROAD, Outcome.TIMEOUT):
        assert reward.end(failure) == -1.0
    assert reward.end(Outcome.SIM_ERROR) == 0.0
