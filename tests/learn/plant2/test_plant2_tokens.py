"""What `plant2` sees: the right things in the right places, and no sign; the catalogue may grow without changing it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from learned_scenes import SPEED, Recorder, record, with_signs

from tsbench.core.errors import InputError
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_planner import RouteAlternatives, SignTokeniser
from tsbench.learn.plant2.sign_tokens import READER, SignMemory, _Held, fill_signs, vocabulary_of, vocabulary_of_catalog
from tsbench.learn.plant2.tokens import Tokeniser
from tsbench.planners.observation import Observation, SignView
from tsbench.planners.weights import load_weights, save_weights
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import EGO_LENGTH_M, Agents

WORDS = vocabulary_of()


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


def test_the_words_are_the_catalogue_s() -> None:
    assert vocabulary_of_catalog(load_catalog()) == WORDS
    assert WORDS.full_stop == ("2.5",)
    assert set(WORDS.right_of_way) == {"2.1", "2.3.1", "2.3.2", "2.3.3", "2.4", "2.5"}
    assert set(WORDS.ends) == {"3.25", "5.22", "5.32"}


def plate(o: Observation, code: str, value: float | None = None, *, ahead: float = 20.0) -> SignView:
    e = o.ego
    x, y = e.x + ahead * math.cos(e.heading), e.y + ahead * math.sin(e.heading)
    return SignView(code, value, x, y, e.heading, o.route.path.edges[0], -1, 0.0, abs(ahead))


def code(held: _Held | None) -> str:
    return "" if held is None else held.sign.code


def test_the_plate_that_holds_is_remembered_and_left_behind(drive: Recorder) -> None:
    o = drive.seen[0]
    memory = SignMemory(drive.context.network, WORDS)
    memory.update(o)
    assert memory.own is None
    limit = plate(o, "3.24", 20.0)
    memory.update(replace(o, signs=(limit,)))
    assert (code(memory.own), memory.own and memory.own.ahead) == ("3.24", pytest.approx(20.0))
    later = replace(o, step=o.step + 1, ego=replace(o.ego, speed=5.0))
    memory.update(later)
    memory.update(later)
    assert (code(memory.own), memory.own and memory.own.ahead) == ("3.24", pytest.approx(19.5))
    away = replace(limit, heading=o.ego.heading + math.pi, code="2.5", value=None)
    elsewhere = replace(limit, edge="ne", code="3.1", value=None)
    masked = replace(limit, code="", value=None)
    memory.update(replace(o, signs=(masked, away, elsewhere)))
    assert code(memory.own) == "3.24"
    memory.update(replace(o, signs=(plate(o, "2.4"), limit)))
    assert code(memory.own) == "2.4"


def test_a_back_has_a_token_where_its_outline_tells_the_code(drive: Recorder) -> None:
    o = drive.seen[0]
    outlines = {"2.1": "diamond", "2.4": "inverted_triangle", "2.5": "octagon", "2.3.1": "triangle", "3.1": "circle"}
    backs = [replace(plate(o, code), outline=outline).from_behind() for code, outline in outlines.items()]
    record = np.zeros(1, dtype=at.SIGN_TOKENS)[0]
    fill_signs(record, replace(o, signs=tuple(backs)), (o.ego.x, o.ego.y, o.ego.heading), 0, WORDS.class_of)
    told = [WORDS.class_of[code] for code in ("2.1", "2.4", "2.5", "2.3.1")]
    assert [k for k in record["sign_classes"].tolist() if k] == told


def test_right_of_way_on_another_arm_holds_beside(drive: Recorder) -> None:
    o, edges = drive.seen[0], drive.context.network.edges
    own = edges[o.route.path.edges[0]]
    other = next(e.id for e in edges.values() if e.target == own.target and e.id != own.id and not e.internal)
    elsewhere = next(e.id for e in edges.values() if e.target != own.target and e.id not in o.route.path.edges)

    def held(kind: str, edge: str) -> tuple[str, str]:
        seen = replace(plate(o, kind), edge=edge, heading=o.ego.heading + 2.0)
        memory = SignMemory(drive.context.network, WORDS)
        memory.update(replace(o, signs=(seen,)))
        return code(memory.own), code(memory.other)

    for kind in WORDS.right_of_way:
        assert held(kind, other) == ("", kind)
    assert held("3.24", other) == held("2.3.1", elsewhere) == held("", other) == ("", "")


@pytest.mark.parametrize("value", [10.0, 35.0, 70.0])
def test_a_value_is_a_number_whatever_it_is(drive: Recorder, value: float) -> None:
    o, record_ = drive.seen[0], np.zeros(1, dtype=at.SIGN_TOKENS)
    memory = SignMemory(drive.context.network, WORDS)
    seen = replace(o, signs=(replace(plate(o, "3.24", value), lane=1),))
    memory.update(seen)
    memory.fill(record_[0], seen, 2)
    assert record_["held_classes"].tolist() == [[WORDS.class_of["3.24"], 0]]
    assert record_["held"][0, 0, :3] == pytest.approx([value / 36.0, 0.0, 0.4], abs=1e-6)
    assert not record_["held"][0, 1].any()


def test_sign_tokens_stand_where_the_plates_are(drive: Recorder, tokeniser: Tokeniser) -> None:
    o = drive.seen[0]
    seen = replace(o, signs=(plate(o, "3.24", 36.0, ahead=10.0), replace(plate(o, "2.5"), code="")))
    record_ = np.zeros(1, dtype=at.SIGN_TOKENS)
    signs = SignTokeniser(tokeniser, RouteAlternatives(drive.context.graph, drive.context.destination), WORDS)
    signs.watch(seen)
    signs.fill(record_[0], seen)
    assert record_["held_classes"].tolist() == [[WORDS.class_of["3.24"], 0]]
    assert record_["held"][0, 0, :3] == pytest.approx([1.0, 0.0, 0.2], abs=1e-6)
    assert WORDS.codes[record_["sign_classes"][0, 0] - 1] == "3.24"
    assert not record_["sign_classes"][0, 1:].any()
    assert record_["signs"][0, 0] == pytest.approx([0.2, 0.0, 1.0, 0.0, 1.0, 0.0], abs=1e-6)
    for name in at.TOKENS.names:
        assert record_[name].tobytes() == tokeniser.tokens(o)[name].tobytes()


def test_a_zone_ends_where_its_end_plate_is_passed(drive: Recorder) -> None:
    o = drive.seen[0]
    memory = SignMemory(drive.context.network, WORDS)
    begin, end = plate(o, "5.31", 20.0, ahead=-15.0), plate(o, "5.32", 20.0, ahead=10.0)
    memory.update(replace(o, signs=(end, begin)))
    assert code(memory.own) == "5.31"
    memory.update(replace(o, signs=(plate(o, "5.32", 20.0, ahead=-1.0), begin)))
    assert code(memory.own) == "5.32"


def test_that_the_ego_has_stood_before_the_line_is_remembered(drive: Recorder) -> None:
    o = drive.seen[0]
    memory, stop = SignMemory(drive.context.network, WORDS), plate(o, "2.5", ahead=2.0)
    line = next(piece.s1 for piece in o.route.path.pieces if o.route.s <= piece.s1)

    def stood(to_line: float, speed: float) -> float:
        route = replace(o.route, s=line - to_line - EGO_LENGTH_M / 2)
        seen = replace(o, route=route, ego=replace(o.ego, speed=speed), signs=(stop,))
        memory.update(seen)
        record_ = np.zeros(1, dtype=at.SIGN_TOKENS)
        memory.fill(record_[0], seen, 0)
        assert record_["held"][0, 0, 3] == pytest.approx(to_line / 50.0, abs=1e-5)
        return float(record_["held"][0, 0, 4])

    assert stood(2.0, 1.0) == 0.0
    assert stood(9.0, 0.0) == 0.0
    assert stood(2.0, 0.1) == 1.0
    assert stood(1.0, 3.0) == 1.0


_NEW = "3.99"


def test_a_new_sign_is_unknown_and_changes_no_token() -> None:
    drive, words = record(), vocabulary_of()

    def tokens(new: bool) -> list[bytes]:
        ways = RouteAlternatives(drive.context.graph, drive.context.destination)
        tokeniser = SignTokeniser(Tokeniser(drive.context.network), ways, words)
        found = []
        for o in map(with_signs, drive.seen):
            plate = replace(o.signs[-1], code=_NEW, value=40.0)
            seen = replace(o, signs=(*o.signs[:1], plate, *o.signs[1:])) if new else o
            frame = np.zeros(1, dtype=at.SIGN_TOKENS)
            tokeniser.watch(seen)
            tokeniser.fill(frame[0], seen)
            found.append(frame.tobytes())
        return found

    assert tokens(new=True) == tokens(new=False)
    assert tokens(new=False) != [tokens(new=False)[0]] * len(drive.seen)


def test_weights_without_a_vocabulary_are_refused(tmp_path: Path) -> None:
    save_weights(READER, tmp_path, load_weights(READER), {"size": "mini"})
    with pytest.raises(InputError, match="no vocabulary of signs"):
        vocabulary_of(tmp_path)
