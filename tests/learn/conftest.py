"""Fixtures of more than one test module."""

from __future__ import annotations

import pytest

from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return read_table(table_path("train"))
