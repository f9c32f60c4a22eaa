"""The one lookup of data: a folder that is named, the clone, or what an installed tsbench has."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import tsbench
from tsbench.core import paths
from tsbench.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    for cached in (paths.data_root, paths._data_package):
        cached.cache_clear()
    yield
    for cached in (paths.data_root, paths._data_package):
        cached.cache_clear()


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tsbench that lies in no clone, with its catalogue; the folder of all packages is given."""
    site = tmp_path / "site-packages"
    (site / "tsbench" / "sign_catalog").mkdir(parents=True)
    monkeypatch.delenv("TSBENCH_DATA", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(paths, "_PACKAGE", site / "tsbench")
    monkeypatch.syspath_prepend(str(site))
    return site


def add_data_package(site: Path, version: str) -> Path:
    folder = site / "tsbench_data"
    (folder / "scenarios").mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / "scenarios" / "test.parquet").touch()
    facts = site / f"tsbench_data-{version}.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: tsbench-data\nVersion: {version}\n", encoding="utf-8"
    )
    return folder


def test_the_clone_is_the_only_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TSBENCH_DATA", raising=False)
    assert paths.data_root() == paths.fetch_root() == ROOT
    assert paths.data_file("scenarios/none.parquet") == ROOT / "scenarios" / "none.parquet"


def test_a_named_folder_wins_and_is_the_only_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TSBENCH_DATA", str(tmp_path))
    with pytest.raises(InputError, match=r"no sign_catalog/ here \(TSBENCH_DATA\)"):
        paths.data_file("scenarios/test.parquet")
    (tmp_path / "sign_catalog").mkdir()
    assert paths.data_file("scenarios/test.parquet") == tmp_path / "scenarios" / "test.parquet"
    assert paths.fetch_root() == tmp_path


def test_an_installed_tsbench_finds_its_own_then_the_packaged_then_the_fetched(installed: Path, tmp_path: Path) -> None:
    user = tmp_path / "home" / "tsbench" / tsbench.__version__
    assert paths.fetch_root() == user
    assert paths.data_file("sign_catalog") == installed / "tsbench" / "sign_catalog"
    assert paths.data_file("scenarios/test.parquet") == user / "scenarios" / "test.parquet"
    paths._data_package.cache_clear()
    packaged = add_data_package(installed, tsbench.__version__)
    (user / "scenarios").mkdir(parents=True)
    for name in ("train", "test"):
        (user / "scenarios" / f"{name}.parquet").touch()
    assert paths.data_file("scenarios/test.parquet") == packaged / "scenarios" / "test.parquet"
    assert paths.data_file("scenarios/train.parquet") == user / "scenarios" / "train.parquet"


def test_data_of_another_version_are_refused(installed: Path) -> None:
    add_data_package(installed, "0.0.9")
    with pytest.raises(InputError, match=r"tsbench-data 0\.0\.9 do not belong together: pip install tsbench-data=="):
        paths.data_file("scenarios/test.parquet")


def test_making_data_needs_a_folder(installed: Path) -> None:
    with pytest.raises(InputError, match="set TSBENCH_DATA to a clone"):
        paths.data_root()
