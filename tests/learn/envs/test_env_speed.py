"""The measurement of the environment's speed: it counts what it says, on few steps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tsbench.cli import main
from tsbench.learn.envs import env_speed as speed


@pytest.mark.slow
def test_bench_measures_each_kind_alone_and_vectorised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(speed, "BLOCK", 40)
    path = tmp_path / "env.json"
    with pytest.raises(SystemExit, match="0"):
        main(["bench", "--env", "--rounds", "1", "--json", str(path)])
    assert "AsyncVectorEnv" in capsys.readouterr().out
    found = json.loads(path.read_text())
    assert set(found) == {"vector", "scene"}
    for rates in found.values():
        assert 0.0 < rates["with_starts"] <= rates["steps_per_s"]
        assert rates["vectorised"] > 0.0
