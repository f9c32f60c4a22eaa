from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from labelled import CASES, play

from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import resolve
from tsbench.roads.localization import LaneLocator
from tsbench.rules.monitor import Monitor, Verdict
from tsbench.rules.monitors import MONITORS, make_monitor, make_monitors, verdicts_of_other_half
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.signs.rule_kinds import RULE_KINDS, read_params
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


@dataclass(frozen=True)
class _Told:
    """Stands for a monitor and for its verdict."""

    violations: tuple[Any, ...]

    def verdict(self) -> _Told:
        return self


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
        first, second = (_run(make_monitors(scene).targets[0], _random_ticks(rule, seed)) for _ in range(2))
        assert first == second


@pytest.mark.parametrize("rule", MONITORS)
@pytest.mark.parametrize("field", ["x", "y", "heading", "speed"])
def test_an_ego_that_is_nowhere_is_an_error(rule: str, field: str) -> None:
    scene = _scene(rule)
    monitor = make_monitors(scene).targets[0]
    tick = _random_ticks(rule, 1, 1)[0]
    for value in (float("nan"), float("inf")):
        nowhere = replace(tick, ego=replace(tick.ego))
        object.__setattr__(nowhere.ego, field, value)
        with pytest.raises(ValueError, match="not finite") as refusal:
            monitor.update(nowhere)
        assert str(refusal.value) == f"step 0: the ego's state is not finite ({nowhere.ego})"


def _refusal(scene: Scene) -> str:
    """What the catalogue's monitors say against a scene's target."""
    with pytest.raises(InputError) as refusal:
        make_monitor(scene.target_signs[0], scene)
    return str(refusal.value)


def _with(scene: Scene, **changes: object) -> Scene:
    """The scene with another target plate; `params`, as texts, are put in the place of those that it has."""
    target, params = scene.target_signs[0], cast(dict[str, str], changes.pop("params", {}))
    if target.params is not None:
        changes["params"] = read_params(type(target.params), {**target.params.texts(), **params})
    wrong = replace(target, **changes)  # type: ignore[arg-type]
    return replace(scene, signs=(wrong, *scene.signs[1:]))


@pytest.mark.parametrize("rule", [name for name, kind in RULE_KINDS.items() if kind.params is not None])
def test_a_plate_without_its_params_is_named(rule: str) -> None:
    scene, kind = _scene(rule), RULE_KINDS[rule].params
    assert kind is not None
    bare = replace(scene, signs=(replace(scene.target_signs[0], params=None), *scene.signs[1:]))
    assert _refusal(bare) == f"sign 'sign0' ({scene.target_signs[0].code}): carries no {kind.__name__}: None"


@pytest.mark.parametrize(
    ("rule", "params", "said"),
    [
        ("give_way", {"approach": "nowhere"}, "param 'approach': no edge 'nowhere'"),
        ("give_way", {"main_in": "w_in nowhere"}, "param 'main_in': no edge 'nowhere'"),
        ("give_way", {"junction": "W"}, "edge 's_in' does not lead to junction 'W'"),
        ("give_way", {"main_in": "w_out"}, "edge 'w_out' does not lead to junction 'C'"),
        ("stop", {"approach": "nowhere"}, "param 'approach': no edge 'nowhere'"),
        ("roundabout", {"ring": "r_e nowhere"}, "param 'ring': no edge 'nowhere'"),
        ("crosswalk", {"crossing": "none"}, "param 'crossing': no crossing 'none'"),
        ("crosswalk", {"exit": "nowhere"}, "param 'exit': no edge 'nowhere'"),
        ("speed", {"zone_edges": "bc"}, "stands on edge 'ab', but its zone starts with 'bc'"),
        ("min_speed", {"zone_edges": "bc cd"}, "stands on edge 'ab', but its zone starts with 'bc'"),
        ("detour", {"obstacle": "none"}, "param 'obstacle': no obstacle 'none'"),
        ("closed_road", {"approach": "nowhere"}, "param 'approach': no edge 'nowhere'"),
        ("manoeuvre", {"junction": "E"}, "edge 's_in' does not lead to junction 'E'"),
        ("one_way_exit", {"approach": "nowhere"}, "param 'approach': no edge 'nowhere'"),
        ("reserved_lane", {"zone_edges": "ab"}, "stands on edge 'bc', but its zone starts with 'ab'"),
        ("reserved_lane", {"lanes": "bc_0 bc_7"}, "param 'lanes': no lane 'bc_7'"),
    ],
)
def test_a_param_that_fits_no_map_is_named(rule: str, params: dict[str, str], said: str) -> None:
    with pytest.raises(InputError) as refusal:
        _with(_scene(rule), params=params)
    assert str(refusal.value) == f"case.add.xml: sign 'sign0': {said}"


def test_a_speed_sign_without_value_and_an_empty_zone_are_named() -> None:
    scene = _scene("speed")
    sign, end = scene.signs
    early, beyond = replace(end, edge="ab", position_m=100.0), replace(end, edge="cd")
    where = "case.add.xml: sign 'sign0': "
    assert _refusal(_with(scene, value=None)) == "sign 'sign0' (3.24): value is missing"
    for position in (110.0, 100.0):
        late = _with(replace(scene, signs=(sign, early)), position_m=position)
        assert _refusal(late) == where + "its zone ends before it starts"
    said = "its end plate 'end' is not on an edge of its zone"
    assert _refusal(replace(scene, signs=(sign, beyond))) == where + said


def test_an_approach_that_leads_nowhere_is_named() -> None:
    scene = _scene("give_way")
    outwards = {"approach": "w_out", "junction": "W", "main_in": "w_out"}
    assert _refusal(_with(scene, params=outwards)) == "case.net.xml: edge 'w_out' leads nowhere (sign 'sign0')"


def test_context_plates_are_watched_where_they_bind_the_ego() -> None:
    scene = _scene("speed")
    own = scene.target_signs[0]
    binding = replace(own, id="second", role="context", position_m=100.0)
    scenery = replace(own, id="third", role="context", code="2.1", value=None, params=None)
    monitors = make_monitors(replace(scene, signs=(*scene.signs, binding, scenery)))
    assert [m.sign.id for m in monitors.others] == ["second"]
    wrong = _Told(("against the lane",))
    said = replace(monitors, wrong_way=cast(Monitor, wrong)).verdicts()
    assert [verdict.sign_id for verdict in said.others] == ["second"]
    assert said.wrong_way == wrong.violations


@pytest.mark.parametrize("kind", ["main_road", "secondary_road", "yield"])
def test_a_drive_has_the_same_verdict_in_either_numbering_of_lanes(kind: str) -> None:
    """The halves' networks number the lanes of their junction differently."""
    data = DataSet()
    loader, runner = SceneLoader(data), EpisodeRunner(resolve("idm"))
    first = next(row for row in data.table("dev") if row.pair_type == kind)
    halves = {row.half: row for row in data.table("dev") if row.pair_id == first.pair_id}
    scenes = {half: loader.load(row)[0] for half, row in halves.items()}
    ids = [[lane.id for lane in scenes[half].network.lanes] for half in ("signed", "contrast")]
    assert ids[0] != ids[1]
    facts = runner.run(halves["signed"]).facts
    here = verdicts_of_other_half(scenes["signed"], scenes["signed"].network, facts.snapshots)
    assert here == facts.verdicts
    there = verdicts_of_other_half(scenes["contrast"], scenes["signed"].network, facts.snapshots)
    assert there.wrong_way == facts.verdicts.wrong_way == ()
    assert not facts.verdicts.compliant
    assert there.compliant
    runner.close()


def test_a_place_on_a_way_is_the_same_place_where_its_lanes_are_cut_and_numbered_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def roads(*lanes: tuple[str, float]) -> Any:
        """The way from `a` to `b` over the lanes whose names begin with ':'."""
        made = [SimpleNamespace(id=n, index=k, internal=n[0] == ":", length=m) for k, (n, m) in enumerate(lanes)]
        place = {lane.id: lane.index for lane in made}
        via = tuple(place[name] for name in sorted(place) if name[0] == ":")
        outgoing = [[SimpleNamespace(to_lane=place["b"], via=via)] if lane.id == "a" else [] for lane in made]
        return SimpleNamespace(lanes=made, outgoing=outgoing)

    own = roads(("a", 50.0), (":1", 4.0), (":2", 6.0), (":3", 5.0), ("b", 40.0))
    other = roads(("b", 40.0), ("a", 50.0), (":1", 7.0), (":2", 5.0), (":3", 3.0))
    seen: list[WorldSnapshot] = []
    watching = SimpleNamespace(update=seen.append, finish=lambda: "judged")
    monkeypatch.setattr("tsbench.rules.monitors.make_monitors", lambda _: watching)
    here = [(0, 12.0), (0, -1.0), (1, 1.5), (2, 3.0), (2, 5.0), (3, 4.0), (4, 8.0), (-1, 0.5)]
    tick = _random_ticks("give_way", 1, 1)[0]
    lanes, places = (np.array(column) for column in zip(*here, strict=True))
    n = len(here)
    actors = replace(tick.actors, index=np.zeros(n, np.int32), lane=lanes, lane_s=places)
    tick = replace(tick, ego=replace(tick.ego, lane=3, s=0.5), actors=actors)
    verdicts: Any = verdicts_of_other_half(cast(Scene, SimpleNamespace(network=other)), own, [tick])
    assert verdicts == "judged"
    moved = seen[0].actors
    there = [(1, 12.0), (1, -1.0), (2, 1.5), (3, 0.0), (3, 2.0), (4, 2.0), (0, 8.0), (-1, 0.5)]
    assert list(zip(moved.lane.tolist(), moved.lane_s.tolist(), strict=True)) == there
    assert moved.lane.dtype == np.int32
    assert moved.lane_s.dtype == np.float64
    assert (seen[0].ego.lane, seen[0].ego.s) == (3, 3.5)
