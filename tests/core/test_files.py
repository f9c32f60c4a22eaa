"""A file is the old one or the new one; nothing else is left beside it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, is_tmp, replacing, sha256_of, write_atomic, write_json


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with replacing(path) as part:
        assert is_tmp(part.name)
        part.write_text("half")
        assert not path.exists()
    assert [p.name for p in path.parent.iterdir()] == ["a.txt"]
    assert sha256_of(path) == hashlib.sha256(b"half").hexdigest()


def test_what_is_broken_off_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomic(path, b"old")

    def write_half() -> None:
        with replacing(path) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a.txt": b"old"}


def test_where_nothing_can_be_written_is_one_line_about_the_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "a"
    with pytest.raises(InputError, match="file: File exists"), io_errors_as_input_errors(path):
        write_atomic(path, b"")
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(InputError, match=r"folder: Is a directory$"), io_errors_as_input_errors(folder):
        write_atomic(folder, b"")


def test_json_for_people(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"b": "ü", "a": 1}, indent=1, sort_keys=True)
    assert (tmp_path / "a.json").read_text() == '{\n "a": 1,\n "b": "ü"\n}\n'
    write_json(tmp_path / "a.json", [1.5])
    assert json.loads((tmp_path / "a.json").read_text()) == [1.5]
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", float("nan"))
