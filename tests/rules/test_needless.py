"""Needless obedience: ordinary driving passes, what a driver without eyes for plates would rather do fails."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import pytest
from labelled import HERE, scene_of, snapshots

from tsbench.core.errors import InputError
from tsbench.planners.idm import IdmParameters, free_road
from tsbench.rules.monitor import Violation
from tsbench.rules.monitors import make_monitors
from tsbench.rules.open_speed import OtherLimits, at_metre
from tsbench.sim.world import DT_S, EGO_LENGTH_M

INITIAL_MPS = (3.61, 7.75, 11.05)
LIMITS_KMH = (30, 50, 60, 70)
_LINE_M = 92.8
_PASSAGE = {"approach": "w_in", "exit": "e_out"}
_BOTH = {"needless_stop": _PASSAGE, "needless_yield": _PASSAGE}


def _ticks(before_line: float, speeds: list[float], clauses: dict[str, object], limit: float) -> list[Violation]:
    """What is needless about an ego whose centre starts so far before the line, with these speeds tick by tick."""
    case = {
        "net": "t", "signs": [{"code": "2.1", "edge": "w_in", "position_m": 85}], "contrast": clauses,
        "ego": {
            "path": ["w_in_0", "e_out_0"], "start": _LINE_M - before_line,
            "speed": [[DT_S, v, w] for v, w in pairwise(speeds)],
        },
    }  # fmt: skip
    scene = scene_of(case, HERE)
    lanes = tuple(replace(lane, speed=limit) for lane in scene.network.lanes)
    scene = replace(scene, network=replace(scene.network, lanes=lanes))
    monitors = make_monitors(scene)
    for tick in snapshots(case, HERE, scene.network):
        monitors.update(tick)
    return list(monitors.finish().needless)


def _drive(v: float, before_line: float, limit: float, most: float, accel: float, slow_to: float = 0.0) -> list[float]:
    """An IDM driver's speeds up to 40 m behind the line. slow_to: between 45 m and 5 m before it, if > 0."""
    s, speeds, p = -before_line, [v], IdmParameters(accel=accel)
    while s < 40.0 and len(speeds) < 600:
        wanted = slow_to if slow_to and -45.0 < s < -5.0 else min(limit, most)
        a = max(free_road(v, wanted, p), -3.0) if v <= wanted else max((wanted - v) / DT_S, -6.0)
        v = max(v + a * DT_S, 0.0)
        s += v * DT_S
        speeds.append(v)
    return speeds


@pytest.mark.parametrize("limit_kmh", LIMITS_KMH)
@pytest.mark.parametrize("initial", INITIAL_MPS)
@pytest.mark.parametrize("accel", [1.0, 1.5, 2.5])
@pytest.mark.parametrize("before_line", [45.0, 60.0, 90.0])
def test_an_ordinary_driver_passes(limit_kmh: int, initial: float, accel: float, before_line: float) -> None:
    limit = limit_kmh / 3.6
    drive = partial(_drive, min(initial, limit), before_line, limit, accel=accel)
    assert _ticks(before_line, drive(most=limit), _BOTH, limit) == []
    assert _ticks(before_line, drive(most=0.8 * limit), _BOTH, limit) == []


@pytest.mark.parametrize("limit_kmh", LIMITS_KMH[1:])
@pytest.mark.parametrize("initial", INITIAL_MPS)
@pytest.mark.parametrize("before_line", [60.0, 90.0])
def test_who_crawls_or_slows_down_to_see_fails(limit_kmh: int, initial: float, before_line: float) -> None:
    limit = limit_kmh / 3.6
    drive = partial(_drive, initial, before_line, limit, accel=1.5)
    crawling, peering = drive(most=4.5), drive(most=limit, slow_to=2.5)
    for speeds in (crawling, peering):
        assert {v.clause for v in _ticks(before_line, speeds, _BOTH, limit)} == {"needless_yield"}


@pytest.mark.parametrize("limit_kmh", LIMITS_KMH[:2])
@pytest.mark.parametrize("initial", INITIAL_MPS)
def test_an_ordinary_driver_is_not_slow(limit_kmh: int, initial: float) -> None:
    limit = limit_kmh / 3.6
    zone = {"zone_edges": "w_in e_out", "start_m": 40.0, "end_m": 120.0, "limit_kmh": float(limit_kmh)}
    speeds = _drive(min(initial, limit), 85.0, limit, limit, 1.5)
    assert _ticks(85.0, speeds, {"needless_slow": zone}, limit) == []
    slow = _drive(min(initial, 0.6 * limit), 85.0, limit, 0.6 * limit, 1.5)
    assert {v.clause for v in _ticks(85.0, slow, {"needless_slow": zone}, limit)} == {"needless_slow"}


def test_a_passage_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="'w_in' does not lead to 'w_out'"):
        _ticks(50.0, [5.0, 5.0], {"needless_stop": {"approach": "w_in", "exit": "w_out"}}, 13.9)


def test_the_speed_of_a_bend_is_that_of_the_nearest_metre() -> None:
    assert [at_metre([9.0, 7.0, 8.0], s) for s in (-4.0, 0.4, 0.6, 2.4, 99.0)] == [9.0, 9.0, 7.0, 8.0, 8.0]


_LIMITED: dict[str, dict[str, Any]] = {
    "at a line": {
        "net": "t", "contrast": {"needless_yield": _PASSAGE},
        "signs": [{"code": "2.1", "edge": "w_in", "position_m": 85}],
        "limit": {"code": "3.24", "edge": "w_in", "params": {"zone_edges": "w_in"}},
        "ego": {"path": ["w_in_0", "e_out_0"], "start": 4.0, "speed": [[4.0, 9.0, 5.5], [14.0, 5.5, 5.5]]},
    },
    # In a zone with a limit another plate's rules from where it stands.
    "before a higher limit": {
        "net": "corridor",
        "contrast": {"needless_slow": {"zone_edges": "bc cd", "start_m": 0, "end_m": 100, "limit_kmh": 50}},
        "signs": [{"code": "3.24", "value": 50, "edge": "bc", "position_m": 0}],
        "limit": {"code": "5.31", "edge": "ab", "params": {"zone_edges": "ab"}},
        "ego": {"path": ["ab_0", "bc_0", "cd_0"], "start": 4.0, "speed": [[4, 9.0, 5.5], [16, 5.5], [5, 5.5, 13.0]]},
    },
}  # fmt: skip


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("where", _LIMITED)
def test_a_limit_of_another_sign_is_a_reason_to_be_slow(where: str, limited: bool) -> None:
    limit = {"value": 20, "position_m": 20, "role": "target"} | _LIMITED[where]["limit"]
    case = _LIMITED[where] | {"targets": 2, "signs": [*_LIMITED[where]["signs"], limit][: 1 + limited]}
    scene = scene_of(case, HERE)
    monitors = make_monitors(scene)
    for tick in snapshots(case, HERE, scene.network):
        monitors.update(tick)
    verdicts = monitors.finish()
    assert bool(verdicts.needless) is not limited
    assert [v.sign_id for v in verdicts.targets] == ["sign0", "sign1"][: 1 + limited]


def test_before_another_signs_limit_the_open_speed_is_what_brakes_calmly_to_it() -> None:
    where = _LIMITED["before a higher limit"]
    limit = {"value": 20, "position_m": 20, "role": "target"} | where["limit"]
    case = where | {"targets": 2, "signs": [*where["signs"], limit]}
    scene = scene_of(case, HERE)
    slow = make_monitors(scene).needless[0]
    limits, calm = OtherLimits(slow), slow.rule.thresholds["calm_mps2"]

    def at(front: float) -> float:
        moved = case | {"ego": where["ego"] | {"start": front - EGO_LENGTH_M / 2}}
        return limits.at(snapshots(moved, HERE, scene.network)[0].ego)

    assert at(12.0) == pytest.approx(math.sqrt((20 / 3.6) ** 2 + 2 * calm * 8.0))
    assert at(20.5) == at(30.0) == pytest.approx(20 / 3.6)
    assert at(scene.network.edge_lanes("ab")[0].line.length + 2.0) == math.inf
