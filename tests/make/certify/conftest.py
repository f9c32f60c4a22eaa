"""Fixtures of more than one test module."""

from __future__ import annotations

import pytest
from simworld import SceneMaker, road_plain

from tsbench.make.maps.netconvert import build_net
from tsbench.roads.network import read_network


@pytest.fixture(scope="module")
def maker(tmp_path_factory: pytest.TempPathFactory) -> SceneMaker:
    root = tmp_path_factory.mktemp("scenarios")
    net = root / "road.net.xml.gz"
    build_net(road_plain(), net)
    return SceneMaker(root, net, read_network(net))
