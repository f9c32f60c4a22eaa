"""A data set in the mirror: traffic keeps to the left, and a drive's mirror image has the drive's verdict."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from drives_in_mirror import IMAGE, compared, evidence
from simworld import cross_plain

from tsbench.core.errors import InputError
from tsbench.geometry.elementary import LEFT, RIGHT, SUMO_TURNS
from tsbench.make.maps.netconvert import build_net
from tsbench.make.scenes.verify import lint_scene
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.mirror import mirrored_network, mirrored_row
from tsbench.scenarios.scene_loader import SceneLoader, load_scene
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.signs.catalog import load_catalog
from tsbench.signs.plates import plate_rgba
from tsbench.signs.rule_kinds import RoundaboutParams
from tsbench.sim.scene import SceneFile

# Two drivers who look at no side: one who obeys, and one whose drives break most rules.
DRIVERS = ("idm-e", "idm")


@pytest.mark.parametrize(
    ("name", "half"), [*((name, SIGNED) for name in DRIVERS), pytest.param("idm", CONTRAST, marks=pytest.mark.slow)]
)
def test_a_drive_in_the_mirror_has_the_verdict_and_evidence_of_the_drive(name: str, half: str) -> None:
    """The first pair of each type: tick by tick the same world, the same outcome, the same events."""
    table = DataSet().table("dev")
    first = {row.pair_type: row.pair_name for row in table[::-1]}
    rows = [row for row in table if row.pair_name in first.values() and row.half == half]
    assert {row.pair_type for row in rows} == {row.pair_type for row in table if row.half == half}
    assert half == CONTRAST or len(rows) == len(load_catalog().types)
    clauses = set()
    for row in rows:
        result = compared(row, name)
        assert result.facts is not None
        clauses |= {(event.rule, event.clause) for event in evidence(result.facts)}
    # The one that looks at no sign breaks the rules of more types than not.
    assert (name, half) != ("idm", SIGNED) or len({rule for rule, _ in clauses}) >= 10, clauses


def rows_of_types() -> Iterator[ScenarioSpec]:
    """One row of each type in the mirror."""
    yield from {row.scenario_type: row for row in IMAGE.table("dev")}.values()


def test_traffic_keeps_to_the_left_and_plates_stand_there() -> None:
    for row in rows_of_types():
        scene, roads = SceneLoader(IMAGE).load(row)
        assert list(lint_scene(scene, roads.graph)) == [], row.scenario_id
        lane = scene.network.edge_lanes(scene.start.lane.rpartition("_")[0])[0]
        # The kerb is on the left, and so is the lane beside the kerb.
        assert scene.network.left_hand
        assert (roads.view.map.left_hand, roads.view.map.kerb_side) == (True, "left")
        assert lane.left == -1
        assert (lane.right >= 0) == (len(scene.network.edges[lane.edge].lanes) > 1)


def test_rings_go_round_clockwise() -> None:
    for data, sign in ((DataSet(), 1.0), (IMAGE, -1.0)):
        scene = load_scene(data, next(r for r in data.table("dev") if r.scenario_type == "roundabout"))
        ring = scene.target_signs[0].params_as(RoundaboutParams).ring
        x, y = np.vstack([scene.network.edge_lanes(edge)[0].line.points for edge in ring]).T
        area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        assert area * sign > 0.0


def test_a_mirror_of_the_mirror_is_the_row() -> None:
    catalog = load_catalog()
    for row in DataSet().table("dev"):
        image = mirrored_row(row, catalog)
        assert mirrored_row(image, catalog) == row
        assert (image.net_sha256, image.additional_sha256) == (row.net_sha256, row.additional_sha256)
    names = [row.scenario_id for row in IMAGE.table("dev")]
    assert len(set(names)) == len(names)


def test_plates_mean_in_the_mirror_what_their_images_mean() -> None:
    left, own, image = IMAGE.catalog, DataSet().artwork(), IMAGE.artwork()
    ring, limit = plate_rgba(image, "4.3", None, 100), plate_rgba(image, "3.24", 50.0, 100)
    assert set(left.sign("3.18.1").rule.options["allowed"]) == {"straight", "left", "u_turn"}
    # Who may turn across the road may turn round: left where traffic keeps to the right.
    assert "u_turn" in left.sign("4.1.2").rule.options["allowed"]
    assert "u_turn" not in left.sign("4.1.3").rule.options["allowed"]
    assert left.sign("5.14.1").rule.option("lane") == "leftmost"
    assert {sign.placement.side for sign in left.signs.values()} == {"left", "obstacle"}
    # A ring's arrows go round the other way; a limit's number does not.
    assert not np.array_equal(ring, plate_rgba(own, "4.3", None, 100))
    assert np.abs(ring[:, ::-1].astype(int) - plate_rgba(own, "4.3", None, 100)).mean() < 2.0
    assert np.array_equal(limit, plate_rgba(own, "3.24", 50.0, 100))


@pytest.fixture(scope="module")
def unsigned(tmp_path_factory: pytest.TempPathFactory) -> tuple[SceneFile, RoadNetwork]:
    """A crossroads without plates."""
    net = cross_plain()
    nodes = tuple(replace(n, type="right_before_left") if n.id == "x" else n for n in net.nodes)
    path = tmp_path_factory.mktemp("nets") / "unsigned.net.xml.gz"
    build_net(replace(net, nodes=nodes), path)
    network = read_network(path)
    return SceneFile(path, gzip.decompress(path.read_bytes())), network


def test_who_comes_from_the_left_goes_first_where_nothing_is_signed(unsigned: tuple[SceneFile, RoadNetwork]) -> None:
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
    with pytest.raises(InputError, match="is made of moscow as it is read"):
        _ = IMAGE.folder


def test_two_cities_are_read_in_turn_in_one_process() -> None:
    """Each keeps its catalogue, its tables and its scenes, whichever was asked last."""
    town = DataSet("north-bayreuth")
    for data in (DataSet(), town, IMAGE, DataSet(town.city, mirrored=True)) * 2:
        rows, stored = data.table("dev"), DataSet(data.city).table("dev")
        assert (rows == stored) is not data.mirrored
        assert data.catalog == load_catalog(mirrored=data.mirrored)
        scene = load_scene(data, rows[0])
        assert (scene.city, scene.network.left_hand) == (data.city, data.mirrored)
        assert scene.artwork() == data.artwork()
        assert str(scene.net.path).endswith(rows[0].net)
    assert not {row.net_sha256 for row in DataSet().table("dev")} & {row.net_sha256 for row in town.table("dev")}
