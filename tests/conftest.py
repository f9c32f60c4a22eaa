"""Settings and fixtures of the whole suite: property tests draw the same examples everywhere and have no deadline."""

from __future__ import annotations

import gc
import random
import re
from pathlib import Path

import pytest
from hypothesis import settings
from simworld import SceneMaker, block_plain, cross_plain, road_plain, simulation

from tsbench.core.machine import collect_garbage_seldom
from tsbench.make.maps.netconvert import build_net
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.sim.sumo import Simulation

pytest_plugins = ["browsing"]

settings.register_profile("tsbench", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("tsbench")


# What the first two need comes with `make test-slow`; the third drives for more than ten seconds.
SLOW_FIXTURES = {"chromium", "commonroad", "misbehaved"}
WHOLLY_SLOW = re.compile(r"^pytestmark = (\[\s*)?pytest\.mark\.slow\b", re.MULTILINE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """A file that is slow as a whole is not imported where slow tests are not asked for.

    Packages that it imports may be missing in the environment of `make test`.
    """
    unasked = "not slow" in config.option.markexpr and collection_path.suffix == ".py"
    return True if unasked and WHOLLY_SLOW.search(collection_path.read_text(encoding="utf-8")) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Take all that collecting has made out of the garbage collector's sight: it lasts as long as the tests do.

    What tests make is looked at seldom, which takes less time.
    """
    gc.collect()
    gc.freeze()
    collect_garbage_seldom()


@pytest.fixture(autouse=True)
def same_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of a test's own process hand out episodes in one order, so that it ends the same each time."""
    monkeypatch.setattr("tsbench.run.execution.messages._draw", random.Random(1).random)


@pytest.fixture(scope="session")
def net_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("nets")
    build_net(block_plain(), folder / "block.net.xml.gz")
    build_net(cross_plain(), folder / "cross.net.xml.gz")
    build_net(road_plain(), folder / "road.net.xml.gz")
    return folder


@pytest.fixture(scope="session")
def block(net_folder: Path) -> RoadNetwork:
    return read_network(net_folder / "block.net.xml.gz")


@pytest.fixture(scope="session")
def cross(net_folder: Path) -> RoadNetwork:
    return read_network(net_folder / "cross.net.xml.gz")


@pytest.fixture(scope="session")
def road(net_folder: Path) -> RoadNetwork:
    return read_network(net_folder / "road.net.xml.gz")


@pytest.fixture(scope="module")
def drive() -> object:
    """A Recorder after a short drive. Its module is imported only where it is used: it takes a third of a second."""
    from learned_scenes import record

    return record()


@pytest.fixture(scope="session")
def sim() -> Simulation:
    return simulation()


@pytest.fixture(scope="session")
def on_block(net_folder: Path, block: RoadNetwork) -> SceneMaker:
    return SceneMaker(net_folder, net_folder / "block.net.xml.gz", block)


@pytest.fixture(scope="session")
def on_cross(net_folder: Path, cross: RoadNetwork) -> SceneMaker:
    return SceneMaker(net_folder, net_folder / "cross.net.xml.gz", cross)


@pytest.fixture(scope="session")
def on_road(net_folder: Path, road: RoadNetwork) -> SceneMaker:
    return SceneMaker(net_folder, net_folder / "road.net.xml.gz", road)
