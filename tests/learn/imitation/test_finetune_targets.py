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


KEPT = 28.0 / 3.6


@pytest.mark.parametrize(
    ("code", "speeds", "wishes"),
    [
        # Turns are slowed down for four seconds ahead; the least from now on would never set off: it stands now.
        ("4.1.1", ([10.0] * 100, [4.0] * 30, [0.0] * 30, 0.2 * np.arange(1, 41)), {72: 4.0, 95: 0.0, 154: 0.4}),
        # Other corners as the driver does: the decision window begins at 70 m.
        ("4.1.1", ([10.0] * 100, [4.0] * 30, [10.0] * 40), {68: 10.0, 72: 4.0}),
        # An upper limit is kept with a margin, from four seconds before its line on.
        ("3.24", ([10.0] * 90, [29.5 / 3.6] * 100), {30: 10.0, 62: KEPT, 150: KEPT}),
        # Right of way is of the moment: a start is told of when it begins, and not before.
        ("2.4", ([10.0] * 95, [0.0] * 50, [5.0] * 50), {80: 10.0, 90: 0.0, 140: 0.0, 144: 5.0}),
    ],
    ids=["turn", "corner", "limit", "right_of_way"],
)
def test_speeds_are_wished_for_by_rule(code: str, speeds: tuple[Any, ...], wishes: dict[int, float]) -> None:
    obeyed = teacher(code, np.concatenate(speeds), 30.0 if code == "3.24" else None)
    assert {k: wish(obeyed, k) for k in wishes} == pytest.approx(wishes, abs=1e-5)


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
