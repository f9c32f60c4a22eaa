"""The names that contracts are cited by, and that they say whether something was changed."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path

import pytest

import tsbench
from tsbench.cli.diagnosis import Status, check_edition
from tsbench.core.paths import MIRRORED, OWN_CITY, SHIPPED_CITIES
from tsbench.run import edition
from tsbench.run.edition import (
    SCORING,
    Edition,
    contract_now,
    earlier_splits,
    edition_now,
    edition_of,
    editions,
    in_force,
    release,
)
from tsbench.scenarios.certificates import certificates_of
from tsbench.scenarios.data_set import DataSet

FEW = ("dev", "holdout")
SCENES = DataSet().editions()
RELEASED = [split for split in DataSet().splits if split not in earlier_splits(DataSet())]


@pytest.fixture(autouse=True)
def _unedited(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clone that somebody works in has edited code."""
    monkeypatch.setattr(edition, "code_is_local", lambda: False)


@cache
def found(split: str) -> str:
    """The contract of a split as it is on disk; reading its rows takes seconds."""
    return contract_now(DataSet(), split)


@pytest.mark.parametrize("split", RELEASED)
def test_this_tsbench_is_what_was_released(split: str) -> None:
    """Where this fails, rules, scenes, code or versions have changed: if that is meant, `make edition`."""
    (scenes,) = [e for e in editions() if e.name == SCENES[split]]
    assert found(split) == scenes.released[tsbench.__version__][split]
    assert edition_of(found(split), "", DataSet()) == scenes.name


@pytest.mark.parametrize("city", SHIPPED_CITIES)
@pytest.mark.parametrize("split", ["dev", "test"])
def test_a_city_that_is_shipped_is_what_was_released(city: str, split: str) -> None:
    town = DataSet.named(city)
    assert edition_of(contract_now(town, split), "", town) == f"{city}-{in_force(town).name}", "make edition"
    assert len(town.table(split)) >= {"dev": 2, "test": 200}[split]


@pytest.mark.parametrize("city", [OWN_CITY, "north-bayreuth", "andorra"])
def test_a_mirrored_data_set_has_a_contract_of_its_own(city: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named after what it mirrors: also where not a word of a row changes, as in Andorra's rings."""
    town = DataSet.named(city)
    stored, name = contract_now(town, "dev"), edition_now(town)
    town = DataSet.named(f"{MIRRORED}{city}")
    image = contract_now(town, "dev")
    now = in_force(town).name
    assert edition_now(town) == f"{MIRRORED}{city}-{now}"
    assert edition_of("f" * 64, "", town) == f"{MIRRORED}{city}-{now}+local"
    assert image != stored
    # It is released with the one that it follows from.
    made = Edition(name, "", {tsbench.__version__: {"dev": stored}})
    which = "editions" if city == OWN_CITY else "built_editions"
    monkeypatch.setattr(edition, which, lambda: (made,))
    assert edition_of(image, "", DataSet()) == f"{MIRRORED}{city}-{now}"
    assert edition_of(stored, "", DataSet()) == name


def test_a_changed_contract_does_not_pass_under_the_name() -> None:
    name = in_force(DataSet()).name
    assert edition_of("f" * 64, "", DataSet()) == f"{name}+local"
    # Nor does a run's own word make it one.
    assert edition_of("f" * 64, name, DataSet()) == f"{name}+local"
    assert edition_of("f" * 64, "2031.1+local", DataSet()) == "2031.1+local"
    assert edition_of("f" * 64, ["no", "name"], DataSet()) == f"{name}+local"
    released = in_force(DataSet()).now()["test"]
    assert edition_of(released, "2031.1", DataSet()) == name
    # Changed code stays marked, whatever the contract.
    assert edition_of(released, "2031.1+local", DataSet()) == f"{name}+local"


def test_a_release_writes_its_version_and_keeps_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "editions.yaml"
    path.write_bytes(edition.PATH.read_bytes())
    monkeypatch.setattr(edition, "PATH", path)
    monkeypatch.setattr(edition, "contract_now", lambda _, split: found(split))
    editions.cache_clear()
    assert release() == {split: found(split) for split in RELEASED}
    assert path.read_bytes() == edition.PATH.read_bytes()
    before = editions()
    monkeypatch.setattr(tsbench, "__version__", "9.9.9")
    monkeypatch.setattr(edition, "contract_now", lambda _, split: split * 16)
    release()
    editions.cache_clear()
    for one, was in zip(editions(), before, strict=True):
        now = {split: split * 16 for split in RELEASED if SCENES[split] == one.name}
        # Results of another scoring stay known; of the same one, other contracts have other results.
        other = not now or was.scoring not in (None, SCORING)
        released = {**was.released, "9.9.9": now} if now else was.released
        assert one == replace(was, released=released, earlier=was.earlier if other else {})
    assert edition_of(RELEASED[0] * 16, "", DataSet()) == SCENES[RELEASED[0]]
    monkeypatch.undo()
    editions.cache_clear()


def test_the_doctor_names_the_edition_and_what_was_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edition, "contract_now", lambda _, split: found(split))
    # Those of all rows are looked at in tests/make/certify/test_certificates_hold.py.
    monkeypatch.setattr(DataSet, "splits", FEW)
    *splits, certificates = check_edition()
    assert [finding.status for finding in splits] == [Status.OK] * len(FEW)
    for split, finding in zip(FEW, splits, strict=True):
        assert finding.text.startswith(f"{SCENES[split]}, contract of the {split} split ")
    rows = sum(len(DataSet().table(split)) for split in FEW)
    assert certificates.text.startswith(f"{rows} rows, each with a certificate of what it is")
    judged = {certificate.scoring for certificate in certificates_of(DataSet())}
    assert (certificates.status is Status.OK) == (judged == {SCORING})
    monkeypatch.setattr(edition, "contract_now", lambda _, split: "f" * 64)
    changed = islice(check_edition(), len(FEW))
    assert [(f.status, f"{in_force(DataSet()).name}+local" in f.text) for f in changed] == [(Status.NOTE, True)] * len(
        FEW
    )


def test_the_doctor_names_the_contract_of_the_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edition, "contract_now", lambda _, split: found(split))
    monkeypatch.setattr(DataSet, "splits", ("test",))
    readme = Path(__file__).parents[2] / "README.md"
    contracts = re.findall(r"^Contract `(\w+)`", readme.read_text(encoding="utf-8"), re.M)
    assert contracts
    finding = next(check_edition())
    assert all(contract in finding.text for contract in [found("test"), *contracts])


def test_the_doctor_says_which_scenes_are_of_an_earlier_edition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edition, "earlier_splits", lambda _: {"train": "2026.2"})
    monkeypatch.setattr(edition, "contract_now", lambda _, split: found(split))
    told = islice(check_edition(), len(RELEASED))
    notes = [finding.text for finding in told if finding.status is Status.NOTE]
    assert notes == ["the scenes of the train split are of 2026.2"]


def test_a_run_says_its_edition(bench) -> None:
    """Fake scenes are nobody's edition."""
    local = f"{editions()[-1].name}+local"
    done = bench.run("run", "--planner", "fake_planners:Good", "--split", "test", "--limit", "2", "--out", "out")
    assert f"edition {local}, contract " in done.stdout
    for name in ("run.json", "summary.json"):
        assert json.loads((bench.folder / "out" / name).read_text())["edition"] == local
    done = bench.run("compare", "out", "out")
    assert f"edition {local}, contract " in done.stdout
