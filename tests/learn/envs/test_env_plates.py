"""Both halves of a pair look different in the environment's tables, also where only the addressed lane differs."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.envs.encoders import KINDS
from tsbench.learn.envs.seen_tables import ADDRESSED, FAR_M, PLATE, SIGNS, AddressedLanes, ObjectsSeen, SceneSeen
from tsbench.planners.base import SignView
from tsbench.signs.model import OUTLINES


def shown(plate: SignView) -> tuple[object, ...]:
    return plate.code, plate.value, plate.x, plate.y, plate.heading, plate.edge, plate.lane, plate.outline


def test_halves_whose_plates_differ_are_shown_differently() -> None:
    """A pair of each type: what a planner is shown in `signs` is in the tables."""
    env = DriveEnv(split="dev", variants="one-per-map")
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
    env.close()
    assert len(compared) == 25  # All types but the four that have no contrast half.


def seen_by(name: str, env: DriveEnv) -> Any:
    seen = KINDS[name]()
    seen.reset(env.episode.context)
    return seen.encode(env.episode.observation)


def test_lanes_are_counted_from_the_egos() -> None:
    env = DriveEnv(split="dev", types="yield", half="signed")
    for scenario in sorted(env._by_id):
        env.reset(options={"scenario": scenario})
        if any(lane.order > 1 for lane in env.episode.context.network.lanes):
            break
    turn, told = env.episode, AddressedLanes()
    env.close()
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


def test_plates_on_the_way_come_first() -> None:
    """Of more plates than there are rows none is lost that the ego has to read."""
    env = DriveEnv(split="dev", types="yield", half="signed")
    env.reset(options={"scenario": min(env._by_id)})
    turn, seen = env.episode, SceneSeen()
    env.close()
    plate, way = turn.observation.signs[0], turn.observation.route.path.edges
    ego = turn.observation.ego
    elsewhere = [replace(plate, edge="elsewhere", x=ego.x + k, y=ego.y) for k in range(10)]
    own = [replace(plate, edge=way[0], x=ego.x + k, y=ego.y) for k in (60.0, 30.0)]
    seen.reset(turn.context)
    rows = seen.encode(replace(turn.observation, signs=(*elsewhere, *own)))["plates"]
    away = np.hypot(rows[:, 0], rows[:, 1]) * FAR_M
    assert away.tolist() == pytest.approx([30.0, 60.0, *range(6)], abs=1e-3)


def test_outlines_and_main_roads_are_in_the_tables() -> None:
    env = DriveEnv(split="dev", types="main_road", half="signed")
    env.reset(options={"scenario": min(env._by_id)})
    turn, scene, objects = env.episode, SceneSeen(), ObjectsSeen()
    env.close()
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
