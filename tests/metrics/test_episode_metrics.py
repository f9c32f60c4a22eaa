"""The metrics of an episode: definitions on hand-made cases, and what must hold for any episode."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import episode_builders as made
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from work import calls

from tsbench.episode.outcome import Contact, EpisodeFacts, Outcome
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.metrics.episode_metrics import episode_metrics as measured
from tsbench.sim.scene import Obstacle
from tsbench.sim.world import EgoState

# The columns that design/interfaces.md promises.
PROMISED = [
    "sign_compliant", "sign_engaged", "destination", "scd", "route_completion", "driving_score", "efficiency",
    "collision", "collision_partner", "at_fault", "off_road", "comfort", "mean_speed", "duration_s", "steps",
    "violations", "needless", "violation_clause", "violation_time_s", "violation_x", "violation_y", "violation_value",
    "violation_threshold",
]  # fmt: skip


def episode_metrics(facts: EpisodeFacts) -> SimpleNamespace:
    return SimpleNamespace(**measured(facts))


def driving(n: int, speed: float = 10.0, x: float = 10.0) -> list[EgoState]:
    return [made.ego(x + speed * 0.1 * k, speed=speed) for k in range(n)]


def test_the_columns_are_the_promised_ones() -> None:
    names = [metric.column for metric in EPISODE_METRICS]
    assert names[: len(PROMISED)] == PROMISED


def test_a_plain_pass() -> None:
    m = episode_metrics(made.facts(driving(391), outcome=Outcome.ARRIVED))
    assert (m.sign_compliant, m.sign_engaged, m.destination, m.scd) == (True, True, True, True)
    assert (m.route_completion, m.driving_score) == (100.0, 100.0)
    assert (m.efficiency, m.min_ttc, m.min_pet) == (None, None, None)
    assert (m.collision, m.collision_partner, m.at_fault, m.off_road) == (False, None, None, False)
    assert (m.mean_speed, m.duration_s, m.steps) == (10.0, 39.0, 390)
    assert (m.violations, m.violation_clause, m.violation_time_s, m.violation_value) == (0, None, None, None)
    assert m.max_overspeed == 0.0
    assert m.comfort == 1.0


def test_a_violation_is_told_by_its_first_event() -> None:
    target = made.verdict(made.violation(2.0), made.violation(5.0, value=60.0), steps=30)
    facts = made.facts(driving(100), outcome=Outcome.ARRIVED, target=target, others=(made.verdict(made.violation()),))
    m = episode_metrics(facts)
    assert (m.sign_compliant, m.destination, m.scd) == (False, True, False)
    assert (m.violations, m.all_violations, m.violating_steps) == (2, 3, 30)
    assert (m.violation_clause, m.violation_time_s, m.violation_x, m.violation_y) == ("over_limit", 2.0, 120.0, -4.8)
    assert (m.violation_value, m.violation_threshold) == (54.1, 41.0)
    assert m.driving_score == pytest.approx(100 * 0.9**3)


def test_needless_obedience_is_no_pass_and_no_violation_of_the_sign() -> None:
    needless = (made.violation(2.0), made.violation(5.0))
    facts = made.facts(driving(391), outcome=Outcome.ARRIVED, needless=needless)
    m = episode_metrics(facts)
    assert (m.sign_compliant, m.destination, m.scd) == (True, True, False)
    assert (m.needless, m.violations, m.all_violations) == (2, 0, 0)
    assert (m.violation_clause, m.violation_time_s) == ("over_limit", 2.0)
    assert m.driving_score == 100.0


def test_completion_and_score_of_a_contact() -> None:
    # From x = 10 to the destination at x = 400; contact after 195 m of 390 m.
    facts = made.facts(driving(196), outcome=Outcome.COLLISION, contact=Contact(195, "pedestrian", "p", False))
    m = episode_metrics(facts)
    assert m.route_completion == pytest.approx(50.0)
    assert m.driving_score == pytest.approx(25.0)
    assert (m.collision, m.collision_partner, m.at_fault, m.scd) == (True, "pedestrian", False, False)


def test_off_road_scores() -> None:
    m = episode_metrics(made.facts(driving(196), outcome=Outcome.OFF_ROAD))
    assert m.off_road
    assert m.driving_score == pytest.approx(35.0)


def test_completion_where_no_route_leads_on() -> None:
    facts = made.facts(driving(196))
    nowhere = type(facts.route)(facts.route.path, 100.0, 0.0, math.inf)
    lost = replace(facts, route=nowhere, start_remaining_m=390.0)
    left_at = 1 - (facts.route.path.destination_s - 100.0) / 390.0
    assert episode_metrics(lost).route_completion == pytest.approx(100 * left_at)


def test_overspeed_and_hard_braking() -> None:
    egos = driving(10, speed=made.LIMIT_MPS + 2.0)
    m = episode_metrics(made.facts(egos))
    assert m.max_overspeed == pytest.approx(2.0)
    assert not m.hard_braking
    egos[4] = made.ego(egos[4].x, speed=5.0, acceleration=-5.0)
    assert episode_metrics(made.facts(egos)).hard_braking


@pytest.mark.parametrize(("standing", "stuck"), [(200, False), (202, True)])
def test_stuck_is_standing_for_more_than_20_s(standing: int, stuck: bool) -> None:
    egos = [made.ego(50.0)] * standing + driving(20, x=50.0)
    assert episode_metrics(made.facts(egos)).stuck is stuck


def test_standing_with_a_reason_is_not_stuck() -> None:
    egos = [made.ego(50.0)] * 300
    ahead = made.Track("a", made.straight(300, 60.0, -4.8, 0.0, 0.0))
    behind = made.Track("b", made.straight(300, 40.0, -4.8, 0.0, 0.0))
    cones = Obstacle("o", "cones", 60.0, -4.8, 0.0, 5.0, 0.5, "east_0")
    assert not episode_metrics(made.facts(egos, [ahead])).stuck
    assert episode_metrics(made.facts(egos, [behind])).stuck
    assert not episode_metrics(made.facts(egos, world=made.scene((cones,)))).stuck
    passing = made.Track("c", made.straight(300, 58.0, 60.0, -math.pi / 2, 6.0))
    assert not episode_metrics(made.facts(egos, [passing])).stuck


def test_the_wrong_way_is_no_pass_and_no_violation_of_the_sign() -> None:
    facts = made.facts(
        driving(391), outcome=Outcome.ARRIVED, wrong_way=(made.violation(5.0),), needless=(made.violation(7.0),)
    )
    m = episode_metrics(facts)
    assert (m.scd, m.sign_compliant, m.wrong_way) == (False, True, True)
    assert (m.violations, m.all_violations, m.violation_time_s) == (0, 0, 5.0)
    assert not episode_metrics(made.facts(driving(30))).wrong_way


def test_no_tick_no_metrics() -> None:
    facts = made.facts(driving(2))
    with pytest.raises(ValueError, match="without a tick"):
        episode_metrics(replace(facts, snapshots=[]))


def test_one_tick_is_enough() -> None:
    m = episode_metrics(made.facts(driving(1), outcome=Outcome.PLANNER_ERROR))
    assert (m.steps, m.duration_s, m.comfort, m.route_completion) == (0, 0.0, None, 0.0)


@st.composite
def episodes(draw: st.DrawFn) -> EpisodeFacts:
    n = draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    step = rng.uniform(0.0, 2.0, n)
    x, y = 10.0 + np.cumsum(step), rng.uniform(-7.0, 7.0, n)
    y[0] = -4.8  # navigation needs a lane to start from
    headings, accelerations = rng.uniform(-9, 9, n), rng.normal(size=n).tolist()
    egos = [
        made.ego(float(x[k]), float(y[k]), float(headings[k]), float(10 * step[k]), acceleration=accelerations[k])
        for k in range(n)
    ]
    tracks = []
    for i in range(draw(st.integers(0, 4))):
        poses = np.column_stack((rng.uniform(0, 90, n), rng.uniform(-20, 20, n), rng.uniform(-4, 4, n)))
        poses[rng.random(n) < 0.3] = np.nan
        tracks.append(made.Track(f"t{i}", poses, made.ActorKind(draw(st.integers(0, 3)))))
    outcome = draw(st.sampled_from(list(Outcome)))
    contact = Contact(n - 1, "vehicle", "t0", draw(st.booleans())) if outcome is Outcome.COLLISION else None
    events = [made.violation(float(k)) for k in range(draw(st.integers(0, 3)))]
    others = (made.verdict(*[made.violation()] * draw(st.integers(0, 2))),)
    return made.facts(egos, tracks, outcome=outcome, contact=contact, target=made.verdict(*events), others=others)


@given(episodes())
def test_what_holds_for_any_episode(facts: EpisodeFacts) -> None:
    m = episode_metrics(facts)
    assert m.scd <= min(m.sign_compliant, m.destination)
    assert 0.0 <= m.driving_score <= m.route_completion <= 100.0
    assert m.destination == (facts.outcome is Outcome.ARRIVED)
    assert m.collision == (m.collision_partner is not None) == (m.at_fault is not None)
    assert m.sign_compliant == (m.violations == 0) == (m.violation_clause is None)
    assert m.all_violations >= m.violations
    for share in (m.comfort,):
        assert share is None or 0.0 <= share <= 1.0
    for positive in (m.efficiency, m.min_ttc, m.min_pet, m.max_overspeed, m.mean_speed):
        assert positive is None or (math.isfinite(positive) and positive >= 0.0)
    for value in vars(m).values():
        assert value is None or type(value) in (bool, int, float, str)


def test_cost() -> None:
    n = 601
    heading = np.cumsum(np.where((np.arange(n) > 200) & (np.arange(n) < 260), 0.026, 0.0))
    x, y = 10 + np.cumsum(0.6 * np.cos(heading)), -4.8 + np.cumsum(0.6 * np.sin(heading))
    egos = [made.ego(float(x[k]), float(y[k]), float(heading[k]), 6.0) for k in range(n)]
    ways = [0.0, math.pi, math.pi / 2, -math.pi / 2]
    tracks = [made.Track(f"t{i}", made.straight(n, 30.0 * i, -10.0 + i, ways[i % 4], 1.0 + i)) for i in range(12)]
    facts = made.facts(egos, tracks)
    episode_metrics(facts)  # fills caches
    # 1,407 calls, 5 ms on a quiet machine; one call more for each tick would be 601 more.
    assert calls(lambda: episode_metrics(facts)) < 1_900
