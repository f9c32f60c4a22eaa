"""What `plant2` sees: the right things in the right places, and no sign."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from learned_scenes import SPEED, Recorder, record, with_signs

from tsbench.planners.base import Observation, SignView
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.planner_ft import SignTokeniser
from tsbench.planners.plant2.route_alternatives import RouteAlternatives
from tsbench.planners.plant2.signs import SignMemory
from tsbench.planners.plant2.tokens import Tokeniser
from tsbench.planners.plant2.vocabulary import vocabulary_of
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import EGO_LENGTH_M, Agents

WORDS = vocabulary_of()
VOCABULARY = WORDS.words


@pytest.fixture(scope="module")
def drive() -> Recorder:
    return record()


@pytest.fixture(scope="module")
def tokeniser(drive: Recorder) -> Tokeniser:
    return Tokeniser(drive.context.network)


def placed(agents: Agents, pose: np.ndarray) -> Agents:
    boxes = ((*place, *box[3:]) for place, box in zip(map(tuple, pose.tolist()), agents.boxes, strict=True))
    return replace(agents, pose=pose, boxes=tuple(boxes))


def test_objects_stand_where_they_are_nearest_first(drive: Recorder, tokeniser: Tokeniser) -> None:
    tokens = tokeniser.tokens(drive.seen[0])[0]
    kinds = tokens["kinds"].tolist()
    assert kinds[:6] == [at.PEDESTRIAN, at.CAR, *[at.STATIC] * 4]
    assert not any(kinds[6:])
    assert not tokens["objects"][6:].any()
    walker, car = tokens["objects"][0], tokens["objects"][1]
    assert walker[1] * at.POSITION_SCALE_M == pytest.approx(-4.0, abs=0.1)
    assert car[0] * at.POSITION_SCALE_M == pytest.approx(25.0 - 2.25 + 0.1 * SPEED, abs=0.2)
    assert car[2:4] == pytest.approx([1.0, 0.0], abs=1e-6)
    assert car[4] * at.SPEED_SCALE_MPS == pytest.approx(SPEED)
    assert car[5] * at.LENGTH_SCALE_M == pytest.approx(4.5)


def test_what_is_too_far_away_leaves_no_token(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    for away, seen in ((-49.0, True), (-51.0, False), (99.0, True), (101.0, False)):
        c, s = math.cos(o.ego.heading), math.sin(o.ego.heading)
        pose = o.actors.pose.copy()
        pose[:, 0], pose[:, 1] = o.ego.x + c * away, o.ego.y + s * away
        moved = replace(o, actors=placed(o.actors, pose), obstacles=())
        assert bool(tokeniser.tokens(moved)[0]["kinds"].any()) is seen


@pytest.mark.parametrize("side", [at.RANGE_M, at.SIGN_SIDE_M])
def test_who_is_too_far_to_the_side_leaves_no_token(drive: Recorder, side: float) -> None:
    o, tokeniser = drive.seen[0], Tokeniser(drive.context.network, side)
    for left in (side - 1.0, side + 1.0, 1.0 - side, -1.0 - side):
        c, s = math.cos(o.ego.heading), math.sin(o.ego.heading)
        pose = o.actors.pose.copy()
        pose[:, 0], pose[:, 1] = o.ego.x - s * left, o.ego.y + c * left
        moved = replace(o, actors=placed(o.actors, pose), obstacles=())
        assert bool(tokeniser.tokens(moved)[0]["kinds"].any()) is (abs(left) < side)


def test_route_lies_ahead_and_turns_with_the_pose(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    route = tokeniser.tokens(o)[0]["route"] * at.POSITION_SCALE_M
    assert np.allclose(route[:, 0], np.arange(1, at.ROUTE_POINTS + 1), atol=0.05)
    assert np.allclose(route[:, 1], 0.0, atol=0.05)
    x, y, h = o.ego.x, o.ego.y, o.ego.heading
    left = tokeniser.tokens(o, (x - math.sin(h), y + math.cos(h), h))[0]["route"] * at.POSITION_SCALE_M
    assert np.allclose(left[:, 1], -1.0, atol=0.05)
    turned = tokeniser.tokens(o, (x, y, h + 0.1))[0]["route"] * at.POSITION_SCALE_M
    assert np.allclose(np.arctan2(turned[:, 1], turned[:, 0]), -0.1, atol=0.01)


def test_patch_shows_road_and_route_around_the_ego(drive: Recorder, tokeniser: Tokeniser) -> None:
    patch = tokeniser.tokens(drive.seen[0])[0]["patch"]
    row, column = int(at.PATCH_AHEAD_M / at.PATCH_M_PER_PX), at.PATCH_COLUMNS // 2
    assert patch[0, row, column - 1 : column + 1].min() > 200
    assert patch[2, row - 20 : row, column - 1 : column + 1].max() > 200
    assert patch[2, row, 0] == 0
    assert patch[0, row, -1] == 0


def test_limits_are_the_roads_own_here_and_ahead(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    limits = tokeniser.tokens(o)[0]["limits"] * at.SPEED_SCALE_MPS
    path, s = o.route.path, o.route.s
    assert limits.tolist() == pytest.approx([path.limit_at(s), path.limit_at(s + 30.0)], rel=1e-6)


def test_the_base_sees_no_sign(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    assert tokeniser.tokens(o).tobytes() == tokeniser.tokens(with_signs(o)).tobytes()


def test_every_word_is_of_the_catalogue() -> None:
    assert (len(WORDS.classes), len(VOCABULARY), len(set(VOCABULARY))) == (33, 48, 48)
    signs = load_catalog().signs
    assert {code for row in WORDS.classes for code in row} <= set(signs)
    for code in WORDS.class_of:
        assert (code in WORDS.values_kmh) is ((value := signs[code].value) is not None and value.printed)


@pytest.mark.parametrize(("value", "read"), [(20.0, 20), (70.0, 50), (10.0, 20), (39.0, 30)])
def test_a_value_that_was_not_learned_is_not_ignored(drive: Recorder, value: float, read: int) -> None:
    sign = plate(drive.seen[0], "3.24", value)
    assert VOCABULARY[WORDS.state_of(sign) - 1] == f"3.24@{read}"


def plate(o: Observation, code: str, value: float | None = None, *, ahead: float = 20.0) -> SignView:
    e = o.ego
    x, y = e.x + ahead * math.cos(e.heading), e.y + ahead * math.sin(e.heading)
    return SignView(code, value, x, y, e.heading, o.route.path.edges[0], -1, 0.0, abs(ahead))


def test_the_sign_that_holds_is_remembered(drive: Recorder) -> None:
    o = drive.seen[0]
    memory = SignMemory(drive.context.network, WORDS)
    assert memory.update(o) == 0
    limit = plate(o, "3.24", 20.0)
    assert VOCABULARY[memory.update(replace(o, signs=(limit,))) - 1] == "3.24@20"
    assert VOCABULARY[memory.update(o) - 1] == "3.24@20"
    away = replace(limit, heading=o.ego.heading + math.pi, code="2.5", value=None)
    elsewhere = replace(limit, edge="ne", code="3.1", value=None)
    assert VOCABULARY[memory.update(replace(o, signs=(away, elsewhere))) - 1] == "3.24@20"
    assert VOCABULARY[memory.update(replace(o, signs=(plate(o, "2.4"), limit))) - 1] == "2.4"
    assert memory.update(replace(o, signs=(replace(limit, code="", value=None),))) == 0


def test_a_secondary_road_announced_to_another_arm_is_to_give_way(drive: Recorder) -> None:
    o, edges = drive.seen[0], drive.context.network.edges
    own = edges[o.route.path.edges[0]]
    other = next(e.id for e in edges.values() if e.target == own.target and e.id != own.id and not e.internal)
    elsewhere = next(
        e.id for e in edges.values() if e.target != own.target and e.id not in o.route.path.edges
    )

    def state(code: str, edge: str) -> int:
        seen = replace(plate(o, code), edge=edge, heading=o.ego.heading + 2.0)
        return SignMemory(drive.context.network, WORDS).update(replace(o, signs=(seen,)))

    for code in ("2.3.1", "2.3.2", "2.3.3"):
        assert VOCABULARY[state(code, other) - 1] == "2.4"
    assert state("2.1", other) == state("2.3.1", elsewhere) == state("", other) == 0


def test_states_of_plates() -> None:
    def view(code: str, value: float | None) -> SignView:
        return SignView(code, value, 0.0, 0.0, 0.0, "e", -1, 0.0, 0.0)

    assert VOCABULARY[WORDS.state_of(view("5.21", 20.0)) - 1] == "5.21"
    assert VOCABULARY[WORDS.state_of(view("4.6", 50.0)) - 1] == "4.6@50"
    assert VOCABULARY[WORDS.state_of(view("3.24", 90.0)) - 1] == "3.24@50"
    assert WORDS.state_of(view("", None)) == 0


def test_sign_tokens_stand_where_the_plates_are(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    seen = replace(o, signs=(plate(o, "3.24", 36.0, ahead=10.0), replace(plate(o, "2.5"), code="")))
    record_ = np.zeros(1, dtype=at.SIGN_TOKENS)
    signs = SignTokeniser(tokeniser, RouteAlternatives(drive.context.graph, drive.context.destination), WORDS)
    signs.watch(seen)
    signs.fill(record_[0], seen)
    assert VOCABULARY[record_["sign_state"][0] - 1] == "3.24@30"
    assert WORDS.classes[record_["sign_classes"][0, 0] - 1] == ("3.24",)
    assert not record_["sign_classes"][0, 1:].any()
    assert record_["signs"][0, 0] == pytest.approx([0.2, 0.0, 1.0, 0.0, 1.0, 0.0], abs=1e-6)
    for name in at.TOKENS.names:
        assert record_[name].tobytes() == tokeniser.tokens(o)[name].tobytes()


def test_a_zone_ends_where_its_end_plate_is_passed(drive: Recorder) -> None:
    o = drive.seen[0]
    memory = SignMemory(drive.context.network, WORDS)
    begin, end = plate(o, "5.31", 20.0, ahead=-15.0), plate(o, "5.32", 20.0, ahead=10.0)
    assert VOCABULARY[memory.update(replace(o, signs=(end, begin))) - 1] == "5.31@20"
    end = plate(o, "5.32", 20.0, ahead=-1.0)
    assert VOCABULARY[memory.update(replace(o, signs=(end, begin))) - 1] == "5.32@20"


def test_after_a_full_stop_what_is_left_is_to_give_way(drive: Recorder) -> None:
    o = drive.seen[0]
    memory, stop = SignMemory(drive.context.network, WORDS), plate(o, "2.5", ahead=2.0)
    line = next(piece.s1 for piece in o.route.path.pieces if o.route.s <= piece.s1)

    def state(to_line: float, speed: float) -> str:
        route = replace(o.route, s=line - to_line - EGO_LENGTH_M / 2)
        seen = replace(o, route=route, ego=replace(o.ego, speed=speed), signs=(stop,))
        return VOCABULARY[memory.update(seen) - 1]

    assert state(2.0, 1.0) == "2.5"
    assert state(9.0, 0.0) == "2.5"
    assert state(2.0, 0.1) == "2.4"
    assert state(1.0, 3.0) == "2.4"
