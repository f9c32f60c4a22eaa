"""Fixtures of more than one test module."""

from __future__ import annotations

import pytest
from simworld import SceneMaker, road_plain


@pytest.fixture(scope="module")
def maker(tmp_path_factory: pytest.TempPathFactory) -> SceneMaker:
    return SceneMaker.over(road_plain(), tmp_path_factory.mktemp("scenarios"))
