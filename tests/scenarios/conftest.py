"""Hand-made networks and pool rows; the networks are those of the tests of the simulation."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tsbench.maps.build import build_net
from tsbench.maps.network import RoadNetwork, read_network

sys.path.append(str(Path(__file__).resolve().parent.parent / "sim"))
from simworld import SceneMaker, block_plain, cross_plain, road_plain


@pytest.fixture(scope="session")
def scene_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scenes")
    for name, plain in (("block", block_plain()), ("cross", cross_plain()), ("road", road_plain())):
        build_net(plain, folder / f"{name}.net.xml.gz")
    return folder


def _maker(root: Path, name: str) -> SceneMaker:
    net = root / f"{name}.net.xml.gz"
    return SceneMaker(root, net, read_network(net))


@pytest.fixture(scope="session")
def on_block(scene_root: Path) -> SceneMaker:
    return _maker(scene_root, "block")


@pytest.fixture(scope="session")
def on_cross(scene_root: Path) -> SceneMaker:
    return _maker(scene_root, "cross")


@pytest.fixture(scope="session")
def on_road(scene_root: Path) -> SceneMaker:
    return _maker(scene_root, "road")


@pytest.fixture(scope="session")
def cross(on_cross: SceneMaker) -> RoadNetwork:
    return on_cross.network


@pytest.fixture(scope="session")
def block(on_block: SceneMaker) -> RoadNetwork:
    return on_block.network
