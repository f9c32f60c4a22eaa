"""Fixtures of more than one test module."""

from __future__ import annotations

import pytest

from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec


@pytest.fixture(scope="module")
def rows() -> list[ScenarioSpec]:
    return DataSet().table("train")
