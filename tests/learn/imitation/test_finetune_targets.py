"""What an obedient drive teaches: wished speeds by rule, and which ticks are decisions."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tsbench.episode.outcome import EpisodeFacts
from tsbench.geometry.polyline import Polyline
from tsbench.learn.imitation.frames import DriveResult
from tsbench.learn.imitation.targets import FAMILIES, SIGN_FRAME, TARGET_SPECS, FinetuneSampling, SignTargets
from tsbench.planners.observation import Observation
from tsbench.scenarios.scene_loader import Roads
from tsbench.signs.catalog import load_catalog

LINE_S = 100.0


def teacher(code: str, speeds: np.ndarray, value: float | None = None, since: int = 0) -> SignTargets:
    """Of a drive along x at these speeds, one a tick; its sign's line is at x = 100."""
    x = np.concatenate(([0.0], np.cumsum(0.1 * speeds[:-1])))
    egos = [SimpleNamespace(ego=SimpleNamespace(x=a, y=0.0, speed=v)) for a, v in zip(x, speeds, strict=True)]
    lane = SimpleNamespace(line=Polyline(np.array([(0.0, 0.0), (300.0, 0.0)])))
    sign = SimpleNamespace(params=None, edge="e", position_m=LINE_S, value=value)
    scene = SimpleNamespace(target_signs=(sign,), obstacles=(), network=SimpleNamespace(edge_lanes=lambda _: [lane]))
    facts = cast(EpisodeFacts, SimpleNamespace(scene=scene, snapshots=egos))
    driven = DriveResult(facts, cast(Roads, None), since)
    return SignTargets(driven, load_catalog().sign(code).rule, 3, FinetuneSampling())


def wish(obeyed: SignTargets, k: int, seen: Any = None) -> float:
    frame = np.zeros(1, dtype=SIGN_FRAME)[0]
    obeyed.fill(frame, k, cast(Observation, seen), (0.0, 0.0, 0.0), [])
    return float(frame["speed"])


def test_every_rule_has_a_lesson() -> None:
    assert set(TARGET_SPECS) == set(load_catalog().rules)
    assert {lesson.family for lesson in TARGET_SPECS.values()} == set(FAMILIES)


def test_turns_are_slowed_down_for_four_seconds_ahead_and_set_off_after_a_halt() -> None:
    speeds = np.concatenate((np.full(100, 10.0), np.full(30, 4.0), np.zeros(30), 0.2 * np.arange(1, 41)))
    obeyed = teacher("4.1.1", speeds)
    assert wish(obeyed, 72) == pytest.approx(4.0)
    assert wish(obeyed, 95) == 0.0
    # The least from now on would never set off: it stands now.
    assert wish(obeyed, 154) == pytest.approx(0.4)


def test_other_corners_are_slowed_down_for_as_the_driver_does() -> None:
    # The decision window begins at 70 m.
    speeds = np.concatenate((np.full(100, 10.0), np.full(30, 4.0), np.full(40, 10.0)))
    obeyed = teacher("4.1.1", speeds)
    assert wish(obeyed, 68) == pytest.approx(10.0)
    assert wish(obeyed, 72) == pytest.approx(4.0)


def test_an_upper_limit_is_kept_with_a_margin_from_four_seconds_before_its_line() -> None:
    speeds = np.concatenate((np.full(90, 10.0), np.full(100, 29.5 / 3.6)))
    obeyed = teacher("3.24", speeds, 30.0)
    assert wish(obeyed, 30) == pytest.approx(10.0)
    assert wish(obeyed, 62) == pytest.approx(28.0 / 3.6, abs=1e-5)
    assert wish(obeyed, 150) == pytest.approx(28.0 / 3.6, abs=1e-5)


def test_right_of_way_is_of_the_moment() -> None:
    speeds = np.concatenate((np.full(95, 10.0), np.zeros(50), np.full(50, 5.0)))
    obeyed = teacher("2.4", speeds)
    assert wish(obeyed, 80) == pytest.approx(10.0)
    assert wish(obeyed, 90) == 0.0
    # A start is told of when it begins, and not before.
    assert wish(obeyed, 140) == 0.0
    assert wish(obeyed, 144) == pytest.approx(5.0)


def test_a_stop_of_an_instant_is_wished_for_before_and_left_after() -> None:
    down, up = np.linspace(10.0, 0.0, 51), np.linspace(0.2, 8.0, 40)
    speeds = np.concatenate((np.full(71, 10.0), down, up))
    obeyed = teacher("2.5", speeds)
    stop = 71 + 50
    assert abs(float(obeyed._track.s[stop]) - LINE_S) < 8.0
    assert all(wish(obeyed, k) == 0.0 for k in range(stop - 7, stop))
    assert wish(obeyed, stop) == pytest.approx(speeds[stop + 7])


def test_a_minimum_is_exceeded_a_little_unless_somebody_is_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    import tsbench.learn.imitation.targets as targets

    obeyed = teacher("4.6", np.full(200, 7.0), 40.0)
    seen = SimpleNamespace(
        route=SimpleNamespace(path=None, s=20.0), ego=SimpleNamespace(speed=7.0), actors=(), obstacles=()
    )
    found: list[tuple[float, float]] = []
    monkeypatch.setattr(targets, "PathSamples", lambda _: object())
    monkeypatch.setattr(targets, "moving_ahead", lambda *_: found)
    assert wish(obeyed, 50, seen) == pytest.approx(43.0 / 3.6, abs=1e-5)
    found.append((35.0, 20.0))
    assert wish(obeyed, 50, seen) == pytest.approx(43.0 / 3.6, abs=1e-5)
    found.append((35.0, 6.0))
    assert wish(obeyed, 50, seen) == pytest.approx(7.0)


def test_decisions_are_denser_and_nothing_is_taken_from_before_a_takeover() -> None:
    speeds = np.full(200, 10.0)
    obeyed = teacher("2.4", speeds)
    ticks = obeyed.ticks()
    inside = [k for k in ticks if 65.0 <= 1.0 * k <= 112.0]
    assert inside == list(range(65, 113, 5))
    assert [k for k in ticks if k < 65] == [0, 15, 30, 45, 60]
    assert all(obeyed.decides(k) for k in inside)
    assert min(teacher("2.4", speeds, since=71).ticks()) == 75
