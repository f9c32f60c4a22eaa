"""A row's files are what the row says, or the row is refused."""

from __future__ import annotations

import gzip
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import one_line
from simworld import SceneMaker, loader_of, plate

from tsbench.core.xmlfile import read_plain, sha256
from tsbench.make.scenes.verify import verify_rows
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import read_network
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import EgoStart


@pytest.fixture
def made(on_block: SceneMaker, tmp_path: Path) -> tuple[Path, ScenarioSpec]:
    """A scene in a folder of its own, that a test may break."""
    shutil.copy(on_block.net, tmp_path / on_block.net.name)
    net = tmp_path / on_block.net.name
    maker = SceneMaker(tmp_path, net, read_network(net))
    sign = plate(maker.network, "ta", 139.0)
    spec = maker.make("one", EgoStart("ta_0", 60.0, 8.0), Destination("bu", 60.0), ("ta", "ab", "bu"), sign)
    return tmp_path, spec


def refuse(root: Path, spec: ScenarioSpec) -> str:
    with one_line() as said:
        loader_of(root).load(spec)
    # What `scenarios verify` and a run say is the same line.
    assert verify_rows([spec], loader_of(root), lambda _: None) == [(spec.scenario_id, said[0])]
    return said[0]


def test_a_scene_is_loaded_with_its_roads(made: tuple[Path, ScenarioSpec]) -> None:
    root, spec = made
    scene, roads = loader_of(root).load(spec)
    assert scene.network is roads.network is roads.graph.network is roads.locator.network
    assert scene.start == EgoStart("ta_0", 60.0, 8.0)
    assert (scene.seed, scene.horizon) == (spec.seed, spec.horizon)


def test_more_maps_than_are_kept(made: tuple[Path, ScenarioSpec]) -> None:
    root, spec = made
    loader = loader_of(root)
    first = loader.load(spec)[1]
    for k in range(6):
        shutil.copy(root / spec.net, root / f"copy{k}.net.xml.gz")
        loader.load(replace(spec, net=f"copy{k}.net.xml.gz"))
    again = loader.load(spec)[1]
    assert again is not first
    assert list(again.network.edges) == list(first.network.edges)


def test_a_hash_is_of_the_content_not_of_its_packing(made: tuple[Path, ScenarioSpec]) -> None:
    root, spec = made
    path = root / spec.additional
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes()), compresslevel=1))
    loader_of(root).load(spec)
    bare = root / "bare.add.xml"
    bare.write_bytes(gzip.decompress(path.read_bytes()))
    assert sha256(read_plain(bare, "scene file")) == spec.additional_sha256


@pytest.mark.parametrize("which", ["net", "additional"])
def test_a_changed_file(made: tuple[Path, ScenarioSpec], which: str) -> None:
    root, spec = made
    path = root / getattr(spec, which)
    content = gzip.decompress(path.read_bytes())
    path.write_bytes(gzip.compress(content.replace(b"13.89", b"13.90") + b"\n"))
    assert refuse(root, spec) == f"{path}: is not the file that row one names (SHA-256 differs)"


@pytest.mark.parametrize("which", ["net", "additional"])
def test_a_missing_and_a_truncated_file(made: tuple[Path, ScenarioSpec], which: str) -> None:
    root, spec = made
    path = root / getattr(spec, which)
    path.write_bytes(path.read_bytes()[:-60])
    assert f"{path}: cannot be read" in refuse(root, spec)
    path.unlink()
    assert f"{path}: no such scene file" in refuse(root, spec)


@pytest.mark.parametrize(
    ("which", "content", "words"),
    [
        ("net", b"<net><edge", "not a well-formed network"),
        ("net", b"<net/>", "a network without lanes"),
        ("net", b"<additional/>", "<additional> is not a network"),
        ("net", b"<net><edge id='a'><lane id='a_0'/></edge></net>", "malformed network"),
        ("additional", b"<additional><poi", "not a well-formed scene file"),
        ("additional", b"<net/>", "<net> is not a scene file"),
        ("additional", b"", "not a well-formed scene file"),
    ],
)
def test_a_malformed_file_with_the_right_hash(
    made: tuple[Path, ScenarioSpec], which: str, content: bytes, words: str
) -> None:
    """Nothing malformed gets as far as SUMO, which dies of some of it."""
    root, spec = made
    path = root / getattr(spec, which)
    path.write_bytes(content)
    changed = replace(spec, **{f"{which}_sha256": sha256(read_plain(path, "scene file"))})
    assert words in refuse(root, changed)


def test_a_row_of_an_unknown_type(made: tuple[Path, ScenarioSpec]) -> None:
    root, spec = made
    odd = replace(spec, scenario_type="fly")
    counted: list[int] = []
    assert verify_rows([odd, spec], loader_of(root), counted.append) == [("one", "unknown scenario type 'fly'")]
    assert counted == [1, 2]
