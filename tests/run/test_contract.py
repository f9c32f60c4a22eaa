"""The contract covers the scoring number, the data of the rows and versions; edited code is marked."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest
from run_helpers import spec, specs

from tsbench.core import provenance
from tsbench.core.paths import data_root
from tsbench.run import edition
from tsbench.run.edition import contract_hash, contract_now, edition_here
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import Catalog, load_catalog


def test_the_scoring_number_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, catalog = specs(), load_catalog()
    before = contract_hash(rows, catalog)
    monkeypatch.setattr(edition, "SCORING", edition.SCORING + 1)
    assert contract_hash(rows, catalog) != before


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of two files in a clone of its own, which `contract` takes for tsbench's. Its folder."""
    package = tmp_path / "tsbench"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "rules.yaml").write_text("gap: 3.0\n")
    git = ("git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(tmp_path))
    for command in (("init", "-q"), ("add", "."), ("commit", "-q", "-m", "First")):
        subprocess.run([*git, *command], check=True, capture_output=True)
    monkeypatch.setattr(edition, "_PACKAGE", package)
    forget()
    yield package
    monkeypatch.undo()
    forget()


def forget() -> None:
    for known in (edition.code_is_local, edition.code_hash):
        known.cache_clear()


@pytest.mark.parametrize(
    "edit",
    [
        lambda package: (package / "rules.yaml").write_text("gap: 2.0\n"),
        lambda package: (package / "__init__.py").write_text("# a remark\n"),
        lambda package: (package / "more.py").write_text(""),
        lambda package: shutil.rmtree(package.parent / ".git"),
    ],
    ids=["data", "code", "new", "copy"],
)
def test_a_clone_with_changes_is_local(clone: Path, edit: Callable[[Path], object]) -> None:
    assert not edition.code_is_local()
    assert edition_here(contract_now(DataSet(), "dev"), DataSet()) == DataSet().editions()["dev"]
    edit(clone)
    forget()
    assert edition.code_is_local()
    assert edition_here(contract_now(DataSet(), "dev"), DataSet()) == f"{DataSet().editions()['dev']}+local"


def test_an_installed_package_is_compared_with_its_record(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = clone.parent / "tsbench-9.dist-info"
    info.mkdir()
    hashes = {name: edition._recorded(clone / name) for name in ("__init__.py", "rules.yaml")}
    (info / "RECORD").write_text("".join(f"tsbench/{name},sha256={h},1\n" for name, h in hashes.items()))
    (info / "METADATA").write_text("Name: tsbench\nVersion: 9\n")
    shutil.rmtree(clone.parent / ".git")
    monkeypatch.setattr(edition, "files", lambda _: PathDistribution(info).files)
    assert not edition.code_is_local()
    (clone / "rules.yaml").write_text("gap: 2.0\n")
    forget()
    assert edition.code_is_local()


def test_code_that_changes_is_seen(clone: Path) -> None:
    stamps, before = edition.code_stamps(), edition.code_hash()
    assert edition.code_stamps() == stamps
    (clone / "rules.yaml").write_text("gap: 2.5\n")
    assert edition.code_stamps() != stamps
    edition.code_hash.cache_clear()
    assert edition.code_hash() != before


def changed(catalog: Catalog, code: str) -> Catalog:
    rule = replace(catalog.sign(code).rule, thresholds={"tolerance_kmh": 99.0})
    return replace(catalog, signs={**catalog.signs, code: replace(catalog.sign(code), rule=rule)})


def test_the_signs_of_the_rows_count_and_no_others() -> None:
    catalog = load_catalog()
    rows = [spec(1, 0, 0)]  # of 3.24, which 3.25 ends
    assert rows[0].sign_code == "3.24"
    hashes = {code: contract_hash(rows, changed(catalog, code)) for code in ("3.24", "3.25", "2.5")}
    assert hashes["2.5"] == contract_hash(rows, catalog)
    assert len(set(hashes.values())) == 3
    lonely = replace(catalog, signs={c: s for c, s in catalog.signs.items() if c in ("3.24", "3.25")})
    assert contract_hash(rows, lonely) == hashes["2.5"]


def test_a_country_is_nothing_to_a_score(tmp_path: Path) -> None:
    root = tmp_path / "sign_catalog"
    shutil.copytree(data_root() / "sign_catalog", root)
    (root / "countries" / "de.yaml").write_text("not: read\n")
    sign = root / "signs" / "3.24.yaml"
    sign.write_text(sign.read_text().replace("Maximum speed limit", "Another name"))
    assert contract_hash(specs(), load_catalog(root)) == contract_hash(specs(), load_catalog())


def test_versions_count(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, catalog = specs(), load_catalog()
    before = contract_hash(rows, catalog)
    for package in provenance.DECIDING:
        assert provenance.versions()[package]
        other = {**provenance.versions(), package: "0.0"}
        monkeypatch.setattr(edition, "versions", lambda other=other: other)
        assert contract_hash(rows, catalog) != before


def test_rows_count_and_their_order_does_not() -> None:
    rows, catalog = specs(), load_catalog()
    assert contract_hash(rows, catalog) == contract_hash(rows[::-1], catalog)
    other = [replace(rows[0], net_sha256="f" * 64), *rows[1:]]
    assert contract_hash(other, catalog) != contract_hash(rows, catalog)
