"""A copy of tsbench for each test, to add things to."""

from __future__ import annotations

from pathlib import Path

import pytest
from own_copy import Copy, make_copy


@pytest.fixture
def clone(tmp_path: Path) -> Copy:
    return make_copy(tmp_path / "clone")
