"""The committed certificates are of the committed rows, and a sample of them is proved again."""

from __future__ import annotations

from dataclasses import replace

import pytest
from simworld import simulation

from tsbench.make.certify.certifier import Certifier, draw_sample
from tsbench.make.scenes.verify import verify_certificates
from tsbench.run.edition import earlier_splits
from tsbench.scenarios.certificates import Certificate, bases, certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import load_catalog


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return [row for split in DataSet().splits for row in DataSet().table(split)]


@pytest.fixture(scope="module")
def today(rows: list[ScenarioSpec]) -> list[ScenarioSpec]:
    """Those of the last edition: the rules that proved the others are no longer here."""
    found = [row for row in rows if row.split not in earlier_splits(DataSet())]
    assert found
    return found


@pytest.fixture(scope="module")
def proofs() -> dict[str, Certificate]:
    return {c.scenario_id: c for c in certificates_of(DataSet())}


@pytest.fixture(scope="module")
def prover() -> Certifier:
    return Certifier(simulation(), SceneLoader(DataSet()))


def test_every_certificate_is_of_its_row(rows: list[ScenarioSpec]) -> None:
    assert verify_certificates(rows, certificates_of(DataSet()), earlier_splits(DataSet())) == []


@pytest.mark.slow
def test_a_changed_row_has_no_certificate_any_more(today: list[ScenarioSpec]) -> None:
    first = today[0]
    ((name, problem),) = verify_certificates(
        [replace(first, additional_sha256="0" * 64)], certificates_of(DataSet()), earlier_splits(DataSet())
    )
    assert name == first.scenario_id
    assert "its certificate is of another row or SUMO" in problem
    ((_, problem),) = verify_certificates(
        [replace(first, scenario_id="new")], certificates_of(DataSet()), earlier_splits(DataSet())
    )
    assert "has no certificate" in problem


def test_the_basis_is_the_row_without_its_place(rows: list[ScenarioSpec]) -> None:
    """Maps beside it in the table make its place."""
    row = rows[0]
    assert bases([replace(row, additional_sha256="0" * 64)]) != bases([row])
    assert bases([replace(row, place="elsewhere")]) == bases([row])


@pytest.mark.slow
@pytest.mark.parametrize("type_id", [kind.id for kind in load_catalog().types])
def test_a_sample_comes_out_as_it_was_certified(
    type_id: str, today: list[ScenarioSpec], proofs: dict[str, Certificate], prover: Certifier
) -> None:
    """Whatever code made them, and on whatever processor: this one finds the same."""
    drawn = draw_sample([row for row in today if row.pair_type == type_id], 1)
    old = [proofs[row.scenario_id] for row in drawn]
    for was, is_ in zip(old, prover.again(list(zip(drawn, old, strict=True))), strict=True):
        assert was.differences(is_) == []
        assert (is_.reproduced, is_.basis) == (True, was.basis)
