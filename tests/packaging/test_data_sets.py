"""The manifest of the data: it says what is there, and every file of data is in one set."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import ModuleType

import pytest
from data_folder import in_force
from scripts import load_script

from tsbench.core.fetch import MANIFEST, data_sets, fetch_set

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def data_sets_script() -> ModuleType:
    return load_script("data_sets")


def test_the_manifest_is_that_of_the_files(data_sets_script: ModuleType) -> None:
    assert MANIFEST.read_text(encoding="utf-8") == data_sets_script.manifest(), "make manifest"


def test_every_file_of_data_is_in_one_set() -> None:
    tracked = subprocess.run(
        ["git", "ls-files", "scenarios", "sumo_nets"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    listed = [file.name for data in data_sets().values() for file in data.files]
    assert len(listed) == len(set(listed))
    assert set(tracked) - set(listed) == set()


def test_what_is_laid_out_is_what_is_fetched(
    data_sets_script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data_sets_script.lay_out(tmp_path / "origin")
    assert "test: " in capsys.readouterr().out
    root = tmp_path / "data"
    (root / "sign_catalog").mkdir(parents=True)
    with in_force(root):
        for name in ("test", "train"):
            data = data_sets()[name]
            assert fetch_set(data, str(tmp_path / "origin"), lambda file: None) == len(data.files) > 20


def test_a_changed_file_is_not_laid_out(
    data_sets_script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for data in data_sets().values():
        for file in data.files:
            (tmp_path / file.name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file.name).write_bytes(b"")
    monkeypatch.setattr(data_sets_script, "ROOT", tmp_path)
    with pytest.raises(SystemExit, match="is not the file that the manifest names: make manifest"):
        data_sets_script.lay_out(tmp_path / "out")
