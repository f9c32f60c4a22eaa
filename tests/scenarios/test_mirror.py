"""A data set in the mirror: traffic keeps to the left, and a drive's mirror image has the drive's verdict."""

from __future__ import annotations

import gzip
import math
import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from simworld import cross_plain, simulation

from tsbench import Control
from tsbench.core.errors import InputError
from tsbench.core.paths import CITY, MIRRORED, OWN_CITY, dataset_root, using_city
from tsbench.dataset.maps.build import build_net
from tsbench.dataset.scenes.lint import lint_scene
from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.result import EpisodeResult
from tsbench.episode.runner import EpisodeLoop
from tsbench.geometry.angles import LEFT, RIGHT, SUMO_TURNS
from tsbench.planners.registry import resolve
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.rules.events import Violation
from tsbench.scenarios.mirror import mirrored_network, mirrored_row
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog
from tsbench.signs.mirror import mirrored_code
from tsbench.signs.plate_params import RoundaboutParams
from tsbench.signs.plates import plate_rgba
from tsbench.sim.scene import SceneFile
from tsbench.sim.world import ActorKind, WorldSnapshot

Place = tuple[float, float, int]

MIRROR = f"{MIRRORED}{OWN_CITY}"
# Two drivers who look at no side: one who obeys, and one whose drives break most rules.
DRIVERS = ("idm-e", "idm")
EGO_M = 1e-6
# What SUMO rounds another way adds up: one car of 108 drives, after 30 s.
CAR_M = 0.05
# Its pedestrians dodge each other to the same side wherever traffic keeps to: their way along a crossing is the same.
WALKER_M = 2.0
WALKER_ALONG_M = 0.01
WORDS = (
    "rule", "clause", "sign_id", "start_s", "end_s", "speed", "value", "threshold", "margin", "unit", "other"
)  # fmt: skip


@pytest.fixture(autouse=True)
def own_city(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CITY, raising=False)


def drive(spec: ScenarioSpec, name: str, said: list[Control]) -> EpisodeResult:
    """An episode; what its planner said is added to `said`."""
    planner = resolve(name)
    driver = planner.factory()
    moments = EpisodeLoop(simulation=simulation()).play(spec, name, planner.privileged)
    try:
        driver.reset(next(moments))
        seen = moments.send(None)
        while True:
            said.append(driver.act(seen))
            seen = moments.send(said[-1])
    except StopIteration as end:
        return end.value


def replay(spec: ScenarioSpec, privileged: bool, said: list[Control]) -> EpisodeResult:
    """The same commands with the steering wheel turned the other way."""
    moments = EpisodeLoop(simulation=simulation()).play(spec, "mirrored", privileged)
    try:
        next(moments)
        next(moments)
        for command in said:
            moments.send(replace(command, steering=-command.steering))
    except StopIteration as end:
        return end.value
    pytest.fail(f"{spec.scenario_id}: goes on where the other drive ended")


def in_mirror(heading: float) -> float:
    return math.remainder(math.pi - heading, 2.0 * math.pi)


def users(snapshot: WorldSnapshot) -> tuple[dict[str, Place], dict[str, Place]]:
    """Vehicles and pedestrians by id: x, y, lane."""
    found: tuple[dict[str, Place], dict[str, Place]] = ({}, {})
    a = snapshot.actors
    rows = zip(a.index.tolist(), a.kind.tolist(), a.pose.tolist(), a.lane.tolist(), strict=True)
    for row, kind, (x, y, _), lane in rows:
        found[kind == ActorKind.PEDESTRIAN][a.table.ids[row]] = (x, y, lane)
    return found


def assert_same_world(a: WorldSnapshot, b: WorldSnapshot) -> None:
    """One tick of a drive and of its mirror image."""
    assert (b.ego.x, b.ego.y) == pytest.approx((-a.ego.x, a.ego.y), abs=EGO_M)
    assert (b.ego.lane, b.ego.on_road) == (a.ego.lane, a.ego.on_road)
    assert (b.ego.s, b.ego.d) == pytest.approx((a.ego.s, -a.ego.d), abs=EGO_M)
    cars, walkers = zip(users(a), users(b), strict=True)
    assert cars[0].keys() == cars[1].keys()
    for name, (x, y, lane) in cars[0].items():
        assert lane == cars[1][name][2]
        assert math.dist((-x, y), cars[1][name][:2]) <= CAR_M, (a.step, name)
    # Some arrive where they go a moment earlier.
    for name in walkers[0].keys() & walkers[1].keys():
        x, y, _ = walkers[0][name]
        assert math.dist((-x, y), walkers[1][name][:2]) <= WALKER_M, (a.step, name)


def evidence(facts: EpisodeFacts) -> list[Violation]:
    return [e for verdict in (facts.target, *facts.others) for e in verdict.violations] + [*facts.needless]


def assert_same_evidence(a: EpisodeFacts, b: EpisodeFacts) -> None:
    signs = load_catalog().signs
    assert (a.target.engaged, len(evidence(a))) == (b.target.engaged, len(evidence(b)))
    for one, other in zip(evidence(a), evidence(b), strict=True):
        assert other.sign_code == mirrored_code(signs, one.sign_code)
        # A turn's value has a sign: left is positive.
        facts = [
            [abs(v) if isinstance(v := getattr(e, word), float) else v for word in WORDS]
            for e in (one, other)
        ]
        exact = WALKER_ALONG_M if one.rule == "crosswalk" else EGO_M
        assert facts[0] == pytest.approx(facts[1], abs=exact), (one.sentence, other.sentence)
        assert (other.x, other.y) == pytest.approx((-one.x, one.y), abs=EGO_M)
        assert abs(math.remainder(other.heading - in_mirror(one.heading), 2.0 * math.pi)) < EGO_M


@pytest.mark.own_process
@pytest.mark.parametrize("name", DRIVERS)
def test_a_drive_in_the_mirror_has_the_verdict_and_evidence_of_the_drive(name: str) -> None:
    """All types, both halves: tick by tick the same world, the same outcome, the same events."""
    rows = read_table(table_path("dev"))
    assert {row.scenario_type for row in rows} == {kind.id for kind in load_catalog().types}
    clauses = set()
    for row in rows:
        said: list[Control] = []
        result = drive(row, name, said)
        with using_city(MIRROR):
            image = replay(mirrored_row(row), resolve(name).privileged, said)
        assert image.outcome == result.outcome, (row.scenario_id, image.error)
        assert result.facts is not None
        assert image.facts is not None
        assert len(image.facts.snapshots) == len(result.facts.snapshots)
        for tick, other in zip(result.facts.snapshots, image.facts.snapshots, strict=True):
            assert_same_world(tick, other)
        assert_same_evidence(result.facts, image.facts)
        clauses |= {(event.rule, event.clause) for event in evidence(result.facts)}
    # The one that looks at no sign breaks the rules of more types than not.
    assert name != "idm" or len({rule for rule, _ in clauses}) >= 10, clauses


def rows_of_types() -> Iterator[ScenarioSpec]:
    """One row of each type in the mirror."""
    with using_city(MIRROR):
        yield from {row.scenario_type: row for row in read_table(table_path("dev"))}.values()


def test_traffic_keeps_to_the_left_and_plates_stand_there() -> None:
    for row in rows_of_types():
        with using_city(MIRROR):
            scene, roads = SceneLoader().load(row)
            assert list(lint_scene(scene, roads.graph)) == [], row.scenario_id
            lane = scene.network.edge_lanes(scene.start.lane.rpartition("_")[0])[0]
            # The kerb is on the left, and so is the lane beside the kerb.
            assert scene.network.left_hand
            assert (roads.view.map.left_hand, roads.view.map.kerb_side) == (True, "left")
            assert lane.left == -1
            assert (lane.right >= 0) == (len(scene.network.edges[lane.edge].lanes) > 1)


def test_rings_go_round_clockwise() -> None:
    for city, sign in ((OWN_CITY, 1.0), (MIRROR, -1.0)):
        with using_city(city):
            row = next(r for r in read_table(table_path("dev")) if r.scenario_type == "roundabout")
            scene, _ = SceneLoader().load(row)
            ring = scene.target_sign.params_as(RoundaboutParams).ring
            x, y = np.vstack([scene.network.edge_lanes(edge)[0].line.points for edge in ring]).T
            area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
            assert area * sign > 0.0


def test_a_mirror_of_the_mirror_is_the_row() -> None:
    for row in read_table(table_path("dev")):
        image = mirrored_row(row)
        assert mirrored_row(image) == row
        assert (image.net_sha256, image.additional_sha256) == (row.net_sha256, row.additional_sha256)
    with using_city(MIRROR):
        names = [row.scenario_id for row in read_table(table_path("dev"))]
    assert len(set(names)) == len(names)


def test_plates_mean_in_the_mirror_what_their_images_mean() -> None:
    with using_city(MIRROR):
        left = load_catalog()
        ring = plate_rgba("4.3", None, 100)
    assert set(left.sign("3.18.1").rule.options["allowed"]) == {"straight", "left", "u_turn"}
    # Who may turn across the road may turn round: left where traffic keeps to the right.
    assert "u_turn" in left.sign("4.1.2").rule.options["allowed"]
    assert "u_turn" not in left.sign("4.1.3").rule.options["allowed"]
    assert left.sign("5.14.1").rule.option("lane") == "leftmost"
    assert {sign.placement.side for sign in left.signs.values()} == {"left", "obstacle"}
    # A ring's arrows go round the other way; a limit's number does not.
    assert not np.array_equal(ring, plate_rgba("4.3", None, 100))
    assert np.abs(ring[:, ::-1].astype(int) - plate_rgba("4.3", None, 100)).mean() < 2.0
    with using_city(MIRROR):
        limit = plate_rgba("3.24", 50.0, 100)
    assert np.array_equal(limit, plate_rgba("3.24", 50.0, 100))


@pytest.fixture(scope="module")
def unsigned(tmp_path_factory: pytest.TempPathFactory) -> tuple[SceneFile, RoadNetwork]:
    """A crossroads without plates."""
    net = cross_plain()
    nodes = tuple(replace(n, type="right_before_left") if n.id == "x" else n for n in net.nodes)
    path = tmp_path_factory.mktemp("nets") / "unsigned.net.xml.gz"
    build_net(replace(net, nodes=nodes), path)
    network = read_network(path)
    return SceneFile(path, gzip.decompress(path.read_bytes())), network


def test_who_comes_from_the_left_goes_first_where_nothing_is_signed(
    unsigned: tuple[SceneFile, RoadNetwork],
) -> None:
    file, before = unsigned
    image = mirrored_network(file)
    assert b'type="right_before_left"' in file.content
    assert b'type="right_before_left"' not in image.content
    assert b'type="left_before_right"' in image.content
    after = read_network(image.path, image.content)
    for one, other in zip(before.connections, after.connections, strict=True):
        assert other.yields_to == one.yields_to
        swapped = {LEFT: RIGHT, RIGHT: LEFT}
        turn = SUMO_TURNS[one.direction]
        assert SUMO_TURNS[other.direction] == swapped.get(turn, turn)


def test_no_digit_of_a_place_is_lost(unsigned: tuple[SceneFile, RoadNetwork]) -> None:
    file, before = unsigned
    image = mirrored_network(file)
    after = read_network(image.path, image.content)
    for one, other in zip(before.lanes, after.lanes, strict=True):
        assert np.array_equal(other.line.points, one.line.points * (-1.0, 1.0))
        assert (other.left, other.right) == (one.right, one.left)
    again = mirrored_network(image)
    assert read_network(again.path, again.content.replace(b' lefthand="true"', b"")).edges == before.edges


def test_nothing_is_built_in_a_mirror() -> None:
    with using_city(MIRROR), pytest.raises(InputError, match="is made of moscow as it is read"):
        dataset_root()
    assert CITY not in os.environ
