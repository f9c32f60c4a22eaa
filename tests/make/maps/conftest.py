"""Fixtures of the map tests: a data root of their own and the made-up town as an extract."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from data_folder import in_force
from town import make_town

from tsbench.make import city as cities
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.scenarios.data_set import DataSet

REPOSITORY = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def workplace_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data root of the tests' own, so that no cache of the clone is read or written."""
    root = tmp_path_factory.mktemp("data")
    shutil.copytree(REPOSITORY / "sign_catalog", root / "sign_catalog")
    (root / "sumo_nets").mkdir()
    (root / "extracts").mkdir()
    shutil.copytree(REPOSITORY / "sumo_nets" / "netconvert", root / "sumo_nets" / "netconvert")
    shutil.copytree(REPOSITORY / "cities", root / "cities", ignore=shutil.ignore_patterns("data"))
    (root / "extracts" / "tiny.osm").write_text(make_town().xml(), encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def workplace(workplace_root: Path) -> Iterator[Path]:
    """The same root, in force while one module runs: other packages' tests see the clone."""
    with in_force(workplace_root):
        yield workplace_root


@pytest.fixture(scope="module")
def osm_dir(workplace: Path) -> Path:
    return workplace / "extracts"


@pytest.fixture(scope="module")
def tiny(osm_dir: Path) -> SourceNetwork:
    return load_source(DataSet(), "tiny", osm_dir)


@pytest.fixture
def described(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in force of descriptions of cities, which is empty."""
    folder = tmp_path / "cities"
    folder.mkdir()
    monkeypatch.setattr(cities, "cities_folder", lambda: folder)
    return folder
