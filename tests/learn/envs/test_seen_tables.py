"""`objects` and `scene`: both halves of a pair differ in their tables; options of `reset`, and ids per group."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from tsbench.core.errors import InputError
from tsbench.learn.envs import GROUPS
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.reward import RewardSpec
from tsbench.learn.envs.seen_tables import (
    ADDRESSED,
    FAR_M,
    KINDS,
    LANE,
    PLATE,
    POINTS,
    SIGNS,
    AddressedLanes,
    ObjectsSeen,
    SceneSeen,
    scene_columns,
    sign_codes,
)
from tsbench.planners.observation import SignView
from tsbench.report.analyses.pages import refresh
from tsbench.signs.model import OUTLINES, Group


def shown(plate: SignView) -> tuple[object, ...]:
    return plate.code, plate.value, plate.x, plate.y, plate.heading, plate.edge, plate.lane, plate.outline


def test_halves_whose_plates_differ_are_shown_differently(drive_env: Callable[..., DriveEnv]) -> None:
    """A pair of each type: what a planner is shown in `signs` is in the tables."""
    env = drive_env(split="dev", variants="one-per-map")
    pairs: dict[str, list[Any]] = defaultdict(list)
    for row in sorted(env._rows, key=lambda row: (row.pair_type, row.scenario_id)):
        pairs[row.scenario_id.removesuffix("-c")].append(row)
    compared: dict[str, int] = {}
    for halves in pairs.values():
        kind = halves[0].pair_type
        if len(halves) < 2 or kind in compared:
            continue
        tables: list[dict[str, Any]] = []
        plates = []
        for row in halves:
            env.reset(options={"scenario": row.scenario_id})
            plates.append([shown(plate) for plate in env.episode.observation.signs])
            tables.append({name: seen_by(name, env) for name in ("scene", "objects")})
        if plates[0] == plates[1]:
            continue  # The plate is not in sight yet.
        compared[kind] = len(halves)
        assert not tables[0]["scene"]["lanes_mask"].all(), kind  # No piece of a lane is left out.
        for name in ("scene", "objects"):
            one, other = (table[name] for table in tables)
            assert any(not np.array_equal(one[key], other[key]) for key in one), (kind, name)
    assert len(compared) == 25  # All types but the four that have no contrast half.


def seen_by(name: str, env: DriveEnv) -> Any:
    seen = KINDS[name]()
    seen.reset(env.episode.context)
    return seen.encode(env.episode.observation)


def test_lanes_are_counted_from_the_egos(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="direction_straight", half="signed")
    for scenario in sorted(env._by_id):
        env.reset(options={"scenario": scenario})
        if any(lane.order > 1 for lane in env.episode.context.network.lanes):
            break
    turn, told = env.episode, AddressedLanes()
    lanes, way = turn.context.network.lanes, turn.observation.route.path.edges
    told.reset(turn.context)
    order = lanes[turn.observation.ego.lane].order
    plate = turn.observation.signs[0]

    def one(lane: int, edge: str = way[0], at: int = turn.observation.ego.lane) -> dict[str, float]:
        o = replace(
            turn.observation, ego=replace(turn.observation.ego, lane=at), signs=(replace(plate, lane=lane, edge=edge),)
        )
        return dict(zip(ADDRESSED, told(o)[0].tolist(), strict=True))

    assert one(order) == {"one_lane": 1.0, "lanes_left": 0.0, "on_route": 1.0}
    assert one(order + 1)["lanes_left"] == 1.0
    assert one(-1) == {"one_lane": 0.0, "lanes_left": 0.0, "on_route": 1.0}
    assert one(order, edge="elsewhere")["on_route"] == 0.0
    beside = next(lane.index for lane in lanes if not lane.internal and lane.order == order + 1)
    assert one(order, at=beside)["lanes_left"] == -1.0
    # In a junction and off the road the last lane counts.
    inside = next(lane.index for lane in lanes if lane.internal)
    assert [one(order, at=where)["lanes_left"] for where in (inside, -1)] == [-1.0, -1.0]
    hidden = replace(turn.observation, signs=(plate.masked(),))
    assert not told(hidden).any()
    assert told(replace(turn.observation, signs=())).shape == (0, 3)


def test_plates_on_the_way_come_first(drive_env: Callable[..., DriveEnv]) -> None:
    """Of more plates than there are rows none is lost that the ego has to read."""
    env = drive_env(split="dev", types="yield", half="signed")
    env.reset(options={"scenario": min(env._by_id)})
    turn, seen = env.episode, SceneSeen()
    plate, way = turn.observation.signs[0], turn.observation.route.path.edges
    ego = turn.observation.ego
    elsewhere = [replace(plate, edge="elsewhere", x=ego.x + k, y=ego.y) for k in range(10)]
    own = [replace(plate, edge=way[0], x=ego.x + k, y=ego.y) for k in (60.0, 30.0)]
    seen.reset(turn.context)
    rows = seen.encode(replace(turn.observation, signs=(*elsewhere, *own)))["plates"]
    away = np.hypot(rows[:, 0], rows[:, 1]) * FAR_M
    assert away.tolist() == pytest.approx([30.0, 60.0, *range(6)], abs=1e-3)


def test_outlines_and_main_roads_are_in_the_tables(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev", types="main_road", half="signed")
    env.reset(options={"scenario": min(env._by_id)})
    turn, scene, objects = env.episode, SceneSeen(), ObjectsSeen()
    front = replace(turn.observation.signs[0], code="2.1", outline="diamond", main_road=(-math.pi / 2, math.pi))
    want = {"main_cos_1": 0.0, "main_sin_1": -1.0, "main_cos_2": -1.0, "main_sin_2": 0.0}
    for plate, main in ((front, want), (front.from_behind(), dict.fromkeys(want, 0.0))):
        o = replace(turn.observation, signs=(plate,))
        for seen in (scene, objects):
            seen.reset(turn.context)
        row = scene.encode(o)["plates"][0]
        told = dict(zip(PLATE, row[4:].tolist(), strict=False))
        assert {name: told[name] for name in want} == pytest.approx(main, abs=1e-6)
        assert [name for name in OUTLINES if told[name]] == ["diamond"]
        other = dict(zip(SIGNS, objects.encode(o)["signs"][0].tolist(), strict=True))
        assert {name: other[name] for name in want} == pytest.approx(main, abs=1e-6)
        assert OUTLINES[int(other["outline"]) - 1] == "diamond"
        assert (other["code"] > 0.0) is bool(plate.code)


FULL = np.array([1.0, 0.0], dtype=np.float32)


def fast(reward: object = None) -> tuple[list[float], list[dict[str, object]]]:
    env = DriveEnv(split="dev", types="speed_limit", half="signed", reward=reward)  # type: ignore[arg-type]
    env.reset(options={"scenario": min(env._by_id)})
    rewards, infos, over = [], [], False
    while not over:
        _, earned, terminated, truncated, info = env.step(FULL)
        rewards.append(earned)
        infos.append(info)
        over = terminated or truncated
    env.close()
    return rewards, infos


def test_plates_and_ways_are_told_and_masked_plates_are_not() -> None:
    def first(kind: str, mask: bool) -> dict[str, np.ndarray]:
        made = DriveEnv(split="dev", types="speed", observation=kind, mask_signs=mask)
        seen: dict[str, np.ndarray] = made.reset(options={"scenario": min(made._by_id)})[0]
        made.close()
        return seen

    one, other = (first("objects", mask)["signs"] for mask in (False, True))
    assert one[0, 0] == other[0, 0] == 1.0
    assert one[:, 5].any()
    assert not other[:, 5:].any()
    shown, hidden = (first("scene", mask) for mask in (False, True))
    there = shown["plates_mask"] > 0
    assert there.any()
    assert (shown["plates"][there, 4 + len(PLATE) :].sum(axis=1) == 1.0).all()
    assert not hidden["plates"][:, 4:-1].any()
    assert (hidden["plates"][there, -1] == 1.0).all()
    near = shown["lanes"][shown["lanes_mask"] > 0]
    route = near[:, 2 * POINTS + LANE.index("on_route")] > 0
    assert route.any()
    assert (near[route, 2 * POINTS + LANE.index("leads")] == 1.0).all()


def test_plates_are_the_scene_without_its_lanes(drive_env: Callable[..., DriveEnv]) -> None:
    seen = {}
    for kind in ("scene", "plates"):
        made = drive_env(split="dev", types="yield", observation=kind)
        seen[kind] = made.reset(options={"scenario": min(made._by_id)})[0]
        assert made.observation_space.contains(seen[kind])
    scene, plates = seen["scene"], seen["plates"]
    assert scene.keys() - plates.keys() == {"lanes", "lanes_mask"}
    assert all(np.array_equal(plates[name], scene[name]) for name in plates)


def test_violations_are_told_and_weigh_only_when_asked() -> None:
    plain, infos = fast()
    assert infos[-1]["violations"]
    assert infos[-1]["engaged"]
    priced, _ = fast(RewardSpec(violation=-2.0))
    count = len(infos[-1]["violations"])  # type: ignore[arg-type]
    assert sum(priced) == pytest.approx(sum(plain) - 2.0 * count)

    def own(terms: Mapping[str, float]) -> float:
        return terms["violation"]

    assert sum(fast(own)[0]) == -count


def test_options_narrow_the_draw(drive_env: Callable[..., DriveEnv]) -> None:
    env = drive_env(split="dev")
    for half in ("signed", "contrast"):
        info = env.reset(options={"type": "priority", "half": half})[1]
        assert info["half"] == half
    for wrong, word in (({"half": "third"}, "third"), ({"kind": "yield"}, "kind"), ({"type": "no"}, "no")):
        with pytest.raises(InputError, match=word):
            env.reset(options=wrong)


def test_groups_have_ids() -> None:
    assert sorted(GROUPS.values()) == sorted(get_args(Group))
    for name, group in GROUPS.items():
        made = gymnasium.make(name, split="dev")
        rows = made.unwrapped._rows  # type: ignore[attr-defined]
        assert {row.group for row in rows if row.half == "signed"} == {group}
        assert made.observation_space == SceneSeen().space
        assert made.action_space.shape == (3,)
        before = gymnasium.make(gymnasium.spec(name.replace("v1", "v0")), split="dev")
        assert (before.observation_space.shape, before.action_space.shape) == ((275,), (2,))


def test_the_page_has_the_columns_of_a_scene(tmp_path: Path) -> None:
    head, *rows = scene_columns()
    assert head == ("table", "column", "unit", "meaning")
    assert all(all(row) for row in rows)
    assert len({row[:2] for row in rows}) == len(rows)
    space = SceneSeen().space
    assert isinstance(space, spaces.Dict)
    widths = {name: box.shape[-1] for name, box in space.items() if not name.endswith("_mask") and box.shape}
    # The columns of codes are one row.
    assert Counter(table for table, *_ in rows) + Counter(plates=len(sign_codes())) == widths
    named = [column for table, column, *_ in rows if table == "plates"]
    assert named[4:] == [*PLATE, "code"]
    docs = Path(__file__).parents[3] / "docs"
    copy = tmp_path / "env.md"
    copy.write_bytes((docs / "env.md").read_bytes())
    refresh(copy, tmp_path, {"scene": scene_columns})
    for path in (copy, tmp_path / "tables" / "scene-columns.csv"):
        told = (docs / path.relative_to(tmp_path)).read_bytes()
        assert path.read_bytes() == told, "tsbench analyse pages docs/env.md writes it anew"
