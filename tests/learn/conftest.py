"""Fixtures of more than one test module."""

from __future__ import annotations

from pathlib import Path

import pytest
from oracle_helpers import three_scenarios

from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return read_table(table_path("train"))


@pytest.fixture
def full(tmp_path: Path, rows: list[ScenarioSpec]) -> Path:
    """A folder with the collection `c`."""
    return three_scenarios(tmp_path, rows)
