"""Results are shown under the contract that they were first published under."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

import tsbench
from tsbench.run import edition
from tsbench.run.edition import Edition, edition_of, editions, mirrored_contract, release, standing_contract
from tsbench.scenarios.data_set import DataSet

VERSION = tsbench.__version__
FIRST, SECOND, THIRD = ({"test": c * 64, "dev": c.upper() * 64} for c in "abc")
EARLIER = {"test": [FIRST["test"], SECOND["test"]], "dev": [FIRST["dev"]]}


def test_the_oldest_stands_for_all() -> None:
    made = Edition("2031.1", "", {VERSION: THIRD}, EARLIER)
    tests = (FIRST["test"], SECOND["test"], THIRD["test"])
    assert made.standing() == {
        **dict.fromkeys(tests, FIRST["test"]),
        **dict.fromkeys((FIRST["dev"], THIRD["dev"]), FIRST["dev"]),
    }
    assert made.contracts() == {*THIRD.values(), *EARLIER["test"], *EARLIER["dev"]}


def test_an_older_version_stands_for_itself() -> None:
    made = Edition("2031.1", "", {"0.0.1": FIRST, VERSION: THIRD}, {"test": [SECOND["test"]]})
    assert FIRST["test"] not in made.standing()
    assert FIRST["test"] in made.contracts()


@pytest.fixture
def entered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A table of editions whose last has the contracts THIRD, and the earlier ones."""
    path = tmp_path / "editions.yaml"
    entry = {"name": "2031.1", "title": "x", "released": {VERSION: THIRD}, "earlier": EARLIER}
    path.write_text(yaml.safe_dump([entry]))
    monkeypatch.setattr(edition, "PATH", path)
    monkeypatch.setattr(DataSet, "splits", ("test", "dev"))
    monkeypatch.setattr(edition, "earlier_splits", lambda _: {})
    monkeypatch.setattr(DataSet, "editions", lambda _: {})
    editions.cache_clear()
    yield
    monkeypatch.undo()
    editions.cache_clear()


@pytest.mark.usefixtures("entered")
def test_contracts_of_a_mirror_stand_likewise() -> None:
    for contract in (*EARLIER["test"], THIRD["test"]):
        assert edition_of(contract, "", DataSet()) == "2031.1"
        assert standing_contract(contract) == FIRST["test"]
        assert standing_contract(mirrored_contract(contract)) == mirrored_contract(FIRST["test"])
    assert standing_contract("e" * 64) == "e" * 64


@pytest.mark.usefixtures("entered")
def test_another_contract_leaves_its_splits_earlier_ones_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the scenes of one split are built anew."""
    now = {"test": THIRD["test"], "dev": "d" * 64}
    monkeypatch.setattr(edition, "contract_now", lambda _, split: now[split])
    assert release() == now
    editions.cache_clear()
    assert editions()[-1].earlier == {"test": EARLIER["test"]}
    assert standing_contract(SECOND["test"]) == FIRST["test"]
    assert edition_of(FIRST["dev"], "", DataSet()) == "2031.1+local"


def test_earlier_contracts_that_come_with_tsbench_are_of_its_splits() -> None:
    known = [contract for made in editions() for some in made.earlier.values() for contract in some]
    assert len(known) == len(set(known)) > 10
    assert {split for made in editions() for split in made.earlier} <= set(DataSet().splits)
