"""What an episode leaves in a sandbox's folders is removed, and what it took away comes back."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsbench.run.isolation import belongings
from tsbench.run.isolation.belongings import Belongings


def content(place: Path) -> dict[str, object]:
    return {
        path.relative_to(place).as_posix(): path.readlink()
        if path.is_symlink()
        else path.is_dir() or path.read_text()
        for path in place.rglob("*")
    }


def test_files_are_as_they_were(tmp_path: Path) -> None:
    (tmp_path / "kept" / "below").mkdir(parents=True)
    (tmp_path / "kept" / "file").write_text("first")
    (tmp_path / "turned").write_text("a file")
    (tmp_path / "link").symlink_to("kept/file")
    before = content(tmp_path)
    own = Belongings((tmp_path,))
    for _ in range(2):
        (tmp_path / "new" / "deep").mkdir(parents=True)
        (tmp_path / "new" / "deep" / "file").write_text("x")
        (tmp_path / "kept" / "file").write_text("other")
        (tmp_path / "kept" / "below").rmdir()
        (tmp_path / "link").unlink()
        (tmp_path / "link").symlink_to("/")
        (tmp_path / "turned").unlink()
        (tmp_path / "turned").mkdir()
        (tmp_path / "turned" / "inside").touch()
        own.restore()
        assert content(tmp_path) == before


def test_too_much_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(belongings, "_MOST_BYTES", 10)
    (tmp_path / "file").write_text("eleven bytes")
    with pytest.raises(OSError, match="more than"):
        Belongings((tmp_path,))
