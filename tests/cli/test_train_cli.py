"""`tsbench train plant2-ft` and `train frames`: what they refuse."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import in_process, refused


def test_a_fine_tuning_without_drives_or_base_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    train = in_process("train", capsys)
    out = ("--out", str(tmp_path / "out"))
    missing = refused(train, "frames", "--trajectories", str(tmp_path / "none.parquet"), *out)
    assert "none.parquet" in missing
    (tmp_path / "empty").mkdir()
    base = refused(train, "plant2-ft", "--driver", "idm-e", "--base", str(tmp_path / "empty"), *out)
    assert "plant2.json" in base
    assert not (tmp_path / "out").exists()
