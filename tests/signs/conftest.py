"""Copies of the catalogue to change and to damage."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tsbench.core.paths import data_root


@pytest.fixture
def catalog_copy(tmp_path: Path) -> Path:
    """A catalogue of one's own."""
    return Path(shutil.copytree(data_root() / "sign_catalog", tmp_path / "copy"))


@pytest.fixture
def edited(tmp_path: Path) -> Callable[[str, str, str], Path]:
    """Makes a copy of the catalogue with a text of one file replaced; returns its root."""

    def edit(name: str, old: str, new: str) -> Path:
        folder = tmp_path / f"edited{len(list(tmp_path.iterdir()))}"
        root = Path(shutil.copytree(data_root() / "sign_catalog", folder))
        text = (root / name).read_text(encoding="utf-8")
        assert old in text
        (root / name).write_text(text.replace(old, new), encoding="utf-8")
        return root

    return edit
