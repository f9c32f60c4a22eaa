"""Sheets to look at: which pairs they show."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image as PilImage
from scripts import load_script

from tsbench.scenarios.data_set import DataSet


@pytest.fixture(scope="module")
def script() -> ModuleType:
    return load_script("contact_sheets")


def test_each_pair_has_its_halves_and_a_choice_has_all_types(script: ModuleType) -> None:
    rows = DataSet().table("dev")
    pairs = script.pairs_of(rows)
    assert len(pairs) == sum(row.half != "contrast" for row in rows)
    assert sum(other is not None for _, other in pairs) == sum(row.half == "contrast" for row in rows)
    assert all(other is None or other.pair_id == signed.pair_id for signed, other in pairs)
    routing = [pair for pair in pairs if pair[0].group == "routing"]
    chosen = script.spread(routing, 12)
    assert len(chosen) == 12
    assert {signed.scenario_type for signed, _ in chosen} == {signed.scenario_type for signed, _ in routing}


def test_a_sheet_has_both_halves_side_by_side(script: ModuleType, tmp_path: Path) -> None:
    pairs = script.pairs_of(DataSet().table("dev"))[:1]
    script._save(tmp_path, "two", pairs, None)
    with PilImage.open(tmp_path / "two-1.png") as picture:
        assert picture.width > 2 * script._VIEW.width
        assert picture.height < 2 * script._VIEW.height
