"""Scenes as SUMO's additional files: nothing is lost, and what is broken is said in one line."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import one_line
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree
from simworld import obstacle, plate

from tsbench.core.errors import InputError
from tsbench.make.scenes.traffic import write_additional
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import ContrastClause, PassageParams, SlowZoneParams
from tsbench.sim.scene import ConvoyPlan, EgoStart, Scene, SceneFile, SceneLayout, WalkersPlan
from tsbench.sim.scene_file import layout_elements, read_layout

CONTRAST = (
    ContrastClause("needless_stop", PassageParams("ta", "ab", main_in=("da",))),
    ContrastClause("needless_slow", SlowZoneParams(("ta", "ab"), 3.7, 63.7, 40.0)),
)
CATALOG = load_catalog()
NUMBER = st.floats(0.001, 1e4, allow_nan=False)


def layout(block: RoadNetwork) -> SceneLayout:
    return SceneLayout(
        signs=(plate(block, "ta", 100.1, "3.18.1", junction="a", approach="ta"),), targets=("sign_0",),
        obstacles=(obstacle(block, "ta_1", 70.3),), start=EgoStart("ta_0", 20.5, 7.75),
        destination=Destination("bu", 33.3),
        convoy=ConvoyPlan("ta_0", 4.2, 3.3, 13.9, 5.1, ("convoy_0", "convoy_1"), 1.7),
        route_hint=("ta", "ab", "bu"), compliant_hint=("ta", "ad", "dc", "cb", "bu"),
        walkers=WalkersPlan("ta_0", 1.0, 3.1, 13.9, 13.9, ("walker_0", "walker_1"), (1.1, 1.3), 1.5),
    )  # fmt: skip


def scene_on(block: RoadNetwork, layout: SceneLayout, file: SceneFile) -> Scene:
    facts = {"catalog": CATALOG, "net": file, "additional": file, "network": block}
    return Scene(**vars(layout), **facts, horizon=600, seed=11)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "v0.add.xml.gz"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(NUMBER, NUMBER, NUMBER, st.floats(-math.pi, math.pi), st.booleans(), st.booleans())
def test_what_is_written_comes_back_exactly(
    block: RoadNetwork, file: Path, a: float, b: float, c: float, angle: float, convoy: bool, way: bool
) -> None:
    whole = layout(block)
    assert whole.convoy is not None
    assert whole.walkers is not None
    whole = replace(
        whole,
        start=EgoStart("ta_0", a, b),
        destination=Destination("bu", c),
        obstacles=tuple(replace(o, x=a, y=-b, heading=angle, length=c) for o in whole.obstacles * 2),
        convoy=replace(whole.convoy, ego_zone_m=a, lead_time_s=b, ego_turn_mps=c) if convoy else None,
        walkers=None if convoy else replace(whole.walkers, speeds=(a, b), lead_time_s=c, until_past=way),
        contrast=CONTRAST if way else (),
        targets=("sign_0", "sign_1") if way else ("sign_0",),
        signs=(*whole.signs, replace(whole.signs[0], id="sign_1")),
        compliant_hint=whole.compliant_hint if way else (),
    )
    write_additional(layout_elements(whole, block), file)
    assert read_layout(file, CATALOG) == whole


def test_the_same_layout_gives_the_same_bytes(block: RoadNetwork, tmp_path: Path) -> None:
    one, two = tmp_path / "one.add.xml.gz", tmp_path / "elsewhere.add.xml.gz"
    content = write_additional(layout_elements(layout(block), block), one)
    write_additional(layout_elements(layout(block), block), two)
    assert one.read_bytes() == two.read_bytes()
    assert gzip.decompress(one.read_bytes()) == content
    assert b"OpenStreetMap contributors" in content


def test_a_plain_file_is_read_as_well(block: RoadNetwork, tmp_path: Path) -> None:
    packed, bare = tmp_path / "a.add.xml.gz", tmp_path / "a.add.xml"
    bare.write_bytes(write_additional(layout_elements(layout(block), block), packed))
    assert read_layout(bare, CATALOG) == read_layout(packed, CATALOG)


def test_a_scene_is_its_layout_on_its_network(block: RoadNetwork, tmp_path: Path) -> None:
    whole = layout(block)
    file = SceneFile(tmp_path / "a", b"<additional/>")
    scene = scene_on(block, whole, file)
    assert scene.additional == file
    assert (scene.start, scene.destination, scene.convoy) == (whole.start, whole.destination, whole.convoy)
    assert scene.walkers == whole.walkers
    assert scene.target_signs[0] is scene.signs[0]
    assert scene.compliant_hint[1] == "ad"


def broken(block: RoadNetwork, path: Path, change) -> str:
    """What reading a file says after `change` did something to its elements."""
    elements = layout_elements(layout(block), block)
    change(elements)
    write_additional(elements, path)
    with one_line(str(path)) as said:
        scene_on(block, read_layout(path, CATALOG), SceneFile(path, b""))
    return said[0]


def by_id(elements: list[etree._Element], name: str) -> etree._Element:
    return next(e for e in elements if e.get("id") == name)


def param(elements: list[etree._Element], name: str, key: str, value: str | None) -> None:
    element = by_id(elements, name)
    found = next(p for p in element if p.get("key") == key)
    if value is None:
        element.remove(found)
    else:
        found.set("value", value)


@pytest.mark.parametrize("name", ["start", "destination"])
def test_a_missing_point(block: RoadNetwork, file: Path, name: str) -> None:
    assert name in broken(block, file, lambda es: es.remove(by_id(es, name)))


@pytest.mark.parametrize(
    ("name", "key", "value", "words"),
    [
        ("start", "lane", None, "lane"),
        ("start", "s", "far", "far"),
        ("start", "lane", "zz_0", "start: no lane 'zz_0'"),
        ("start", "target", "sign_7", "target sign 'sign_7'"),
        ("destination", "edge", "zz", "destination: no edge 'zz'"),
        ("convoy", "line_lane", "zz_9", "convoy: no lane 'zz_9'"),
        ("convoy", "lead_time_s", None, "lead_time_s"),
        ("walkers", "line_lane", "zz_9", "walkers: no lane 'zz_9'"),
        ("walkers", "speeds", "1.1", "2 walkers with 1 speeds"),
        ("sign_0", "edge", "zz", "sign sign_0: no edge 'zz'"),
        ("sign_0", "heading", None, "heading"),
        ("sign_0", "position_m", "-3", "position_m"),
        ("obstacle_0", "width", None, "width"),
        ("obstacle_0", "x", "left", "left"),
        ("obstacle_0", "lane", "zz_0", "zz_0"),
        ("sign_0", "lane", "7", "edge 'ta' has no lane 7"),
    ],
)
def test_a_wrong_parameter(block: RoadNetwork, file: Path, name: str, key: str, value: str | None, words: str) -> None:
    assert words in broken(block, file, lambda es: param(es, name, key, value))


def test_a_param_without_a_key(block: RoadNetwork, file: Path) -> None:
    assert "key" in broken(block, file, lambda es: by_id(es, "start")[0].attrib.pop("key"))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a well-formed scene file"),
        (b"<additional><poi", "line 1: not a well-formed scene file"),
        (b"<net/>", "line 1: <net> is not a scene file"),
        (b"\x1f\x8b rubbish", "cannot be read as a scene file"),
        (b"\x00\x01\x02\x03", "not a well-formed scene file"),
        (b"<additional/>", "lacks 'start'"),
    ],
)
def test_what_is_no_scene_file(file: Path, content: bytes, words: str) -> None:
    file.write_bytes(content)
    with one_line(words, str(file)):
        read_layout(file, CATALOG)


@given(st.floats(0.02, 0.98))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
def test_a_truncated_file(block: RoadNetwork, file: Path, share: float) -> None:
    write_additional(layout_elements(layout(block), block), file)
    whole = file.read_bytes()
    file.write_bytes(whole[: max(3, int(len(whole) * share))])
    with one_line("cannot be read as a scene file", str(file)):
        read_layout(file, CATALOG)


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    for path, words in ((tmp_path / "none.xml", "no such scene file"), (tmp_path, "cannot be read")):
        with one_line(words, str(path)):
            read_layout(path, CATALOG)


def test_no_entity_reaches_another_file(file: Path, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("hidden words")
    text = f'<!DOCTYPE a [<!ENTITY e SYSTEM "{tmp_path}/secret">]><additional><poi id="start">&e;</poi></additional>'
    file.write_text(text)
    with pytest.raises(InputError) as told:
        read_layout(file, CATALOG)
    assert "hidden words" not in str(told.value)
