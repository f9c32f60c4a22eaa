from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from labelled import CASES, network, play

from tsbench.errors import InputError
from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.foes import FoeFinder
from tsbench.rules.paths import junction_paths
from tsbench.rules.registry import MONITORS, make_monitor, make_monitors
from tsbench.signs.catalog import load_catalog
from tsbench.sim.place import LaneLocator
from tsbench.sim.scene import Scene
from tsbench.sim.world import ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

ONE_OF_EACH = {
    "give_way": "enters_two_seconds_before",
    "stop": "drives_through",
    "crosswalk": "drives_on",
    "roundabout": "gap_just_too_short",
    "speed": "ignores_the_limit",
    "min_speed": "too_slow",
    "detour": "passes_left",
    "manoeuvre": "turns_left",
    "one_way_exit": "left_on_the_wrong_carriageway",
    "no_entry": "drives_in",
    "closed_road": "drives_in",
    "reserved_lane": "bus_stays_in_its_lane",
}


def _scene(rule: str) -> Scene:
    return play(CASES / rule / f"{ONE_OF_EACH[rule]}.yaml").scene


@cache
def _random_ticks(rule: str, seed: int, count: int = 150) -> list[WorldSnapshot]:
    """An ego and road users that jump about the map, on the road and off it."""
    scene, rng = _scene(rule), np.random.default_rng(seed)
    net, locator, table = scene.network, LaneLocator(scene.network), ActorTable(2)
    routes = [(e.id, f) for e in net.edges.values() for f in _successors(scene, e.id)]
    for k in range(12):
        kind = ActorKind(int(rng.integers(0, 4)))
        route = () if kind is ActorKind.PEDESTRIAN else routes[int(rng.integers(len(routes)))]
        table.add(f"a{k}", kind, float(rng.uniform(0.5, 12)), float(rng.uniform(0.5, 2.5)), route)
    points = np.vstack([lane.line.points for lane in net.lanes])
    lo, hi = points.min(axis=0) - 5, points.max(axis=0) + 5
    ticks, last = [], -1
    for step in range(count):
        x, y, heading = rng.uniform(lo[0], hi[0]), rng.uniform(lo[1], hi[1]), rng.uniform(-4, 4)
        if rng.random() < 0.7:
            lane = net.lanes[int(rng.integers(len(net.lanes)))]
            s = rng.uniform(0, lane.line.length)
            (x, y), heading = lane.line.point_at(s), lane.line.heading_at(s)
        last, s, d, on = locator.locate(x, y, heading, last)
        n = int(rng.integers(0, 13))
        rows = np.sort(rng.choice(12, n, replace=False)).astype(np.int32)
        actors = Actors(
            table, rows, np.column_stack((rng.uniform(lo, hi, (n, 2)), rng.uniform(-4, 4, n))),
            rng.uniform(0, 15, n), rng.integers(-1, len(net.lanes), n).astype(np.int32),
            rng.uniform(0, 90, n),
        )  # fmt: skip
        ego = EgoState(x, y, heading, rng.uniform(0, 20), 0.0, 0.0, 0.0, last, s, d, on)
        ticks.append(WorldSnapshot(step, step * 0.1, ego, actors))
    return ticks


def _successors(scene: Scene, edge: str) -> list[str]:
    net = scene.network
    return [net.lanes[c.to_lane].edge for i in net.edges[edge].lanes for c in net.outgoing[i]]


def _run(monitor: Monitor, ticks: list[WorldSnapshot]) -> Verdict:
    for tick in ticks:
        monitor.update(tick)
    return monitor.finish()


@pytest.mark.parametrize("rule", MONITORS)
def test_same_ticks_give_the_same_verdict(rule: str) -> None:
    scene = _scene(rule)
    for seed in range(4):
        first, second = (
            _run(make_monitors(load_catalog(), scene)[0], _random_ticks(rule, seed)) for _ in range(2)
        )
        assert first == second


@pytest.mark.parametrize("rule", MONITORS)
@pytest.mark.parametrize("field", ["x", "y", "heading", "speed"])
def test_an_ego_that_is_nowhere_is_an_error(rule: str, field: str) -> None:
    scene = _scene(rule)
    monitor, _ = make_monitors(load_catalog(), scene)
    tick = _random_ticks(rule, 1, 1)[0]
    for value in (float("nan"), float("inf")):
        nowhere = replace(tick, ego=replace(tick.ego))
        object.__setattr__(nowhere.ego, field, value)
        with pytest.raises(ValueError, match="not finite"):
            monitor.update(nowhere)


@pytest.mark.parametrize("rule", MONITORS)
def test_a_missing_param_is_named(rule: str) -> None:
    scene = _scene(rule)
    sign = scene.target_sign
    for key in MONITORS[rule].needs:
        poor = replace(sign, params={k: v for k, v in sign.params.items() if k != key})
        with pytest.raises(InputError, match=rf"sign 'sign0': param '{key}'"):
            make_monitor(poor, load_catalog(), replace(scene, signs=(poor,)))


@pytest.mark.parametrize(
    ("rule", "params"),
    [
        ("give_way", {"approach": "nowhere"}),
        ("give_way", {"main_in": "w_in nowhere"}),
        ("give_way", {"junction": "W"}),
        ("give_way", {"main_in": "w_out"}),
        ("stop", {"approach": "nowhere"}),
        ("roundabout", {"ring": "r_e nowhere"}),
        ("speed", {"zone_edges": "bc"}),
        ("detour", {"obstacle": "none"}),
        ("closed_road", {"approach": "nowhere"}),
        ("manoeuvre", {"junction": "E"}),
    ],
)
def test_a_param_that_fits_no_map_is_named(rule: str, params: dict[str, str]) -> None:
    scene = _scene(rule)
    wrong = replace(scene.target_sign, params={**scene.target_sign.params, **params})
    with pytest.raises(InputError, match=r"^case\.add\.xml: sign 'sign0': "):
        make_monitor(wrong, load_catalog(), replace(scene, signs=(wrong,)))


def test_a_speed_sign_without_value_and_an_empty_zone_are_named() -> None:
    scene = _scene("speed")
    sign, end = scene.signs
    for signs in (
        (replace(sign, value=None), end),
        (replace(sign, position_m=110.0), replace(end, edge="ab", position_m=100.0)),
        (sign, replace(end, edge="cd")),
    ):
        with pytest.raises(InputError, match="sign 'sign0'"):
            make_monitor(signs[0], load_catalog(), replace(scene, signs=signs))


def test_a_rule_without_monitor_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = _scene("speed")
    others = {name: monitor for name, monitor in MONITORS.items() if name != "speed"}
    monkeypatch.setattr("tsbench.rules.registry.MONITORS", others)
    with pytest.raises(InputError, match="no monitor for rule 'speed'"):
        make_monitor(scene.target_sign, load_catalog(), scene)


def test_context_plates_are_watched_where_they_bind_the_ego() -> None:
    scene = _scene("speed")
    own = scene.target_sign
    binding = replace(own, id="second", role="context", position_m=100.0)
    scenery = replace(own, id="third", role="context", code="2.1", value=None, params={})
    _, others = make_monitors(load_catalog(), replace(scene, signs=(*scene.signs, binding, scenery)))
    assert [m.sign.id for m in others] == ["second"]


def test_foes_are_found_from_upstream_edges_to_the_exit() -> None:
    net = network("x")
    paths = junction_paths(net, "w_in")
    table = ActorTable()
    table.add("f", ActorKind.CAR, 4.5, 1.8, ("fw_in", "w_in", "e_out"))
    table.add("away", ActorKind.CAR, 4.5, 1.8, ("w_in",))

    def place(lane: str, s: float, row: int = 0) -> object:
        rows, lanes = np.array([row], dtype=np.int32), np.array([net.lane_index[lane]], dtype=np.int32)
        actors = Actors(table, rows, np.zeros((1, 3)), np.zeros(1), lanes, np.array([s]))
        found = FoeFinder(net, paths).find(actors)
        return (net.lanes[paths[found[0].path].connection.from_lane].id, found[0].s) if found else None

    assert place("fw_in_1", 36.75) == ("w_in_1", pytest.approx(36.75 - 100.0 - 89.6, abs=0.02))
    assert place("w_in_0", 80.0) == ("w_in_0", pytest.approx(-9.6))
    assert place(":C_15_1", 3.0) == ("w_in_1", pytest.approx(3.0))
    assert place("e_out_1", 2.0) == ("w_in_1", pytest.approx(22.8))
    assert place("n_in_0", 2.0) is None
    assert place("w_in_0", 80.0, row=1) is None
