"""A network runs in its worker, on the device that the run names."""

from __future__ import annotations

from pathlib import Path

import pytest
from run_helpers import HERE

import tsbench
from tsbench.core.errors import InputError

PLANNER = f"{HERE / 'device_planner.py'}:Steady"


def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, device: str) -> set[str]:
    """The devices on which workers have loaded the planner's network."""
    log = tmp_path / f"{name}.log"
    monkeypatch.setenv("DEVICES_LOG", str(log))
    tsbench.evaluate(
        [PLANNER], split="dev", types=("yield",), limit=2, workers=1, trace="none", device=device, out=tmp_path / name
    )
    return {*log.read_text().split()}


def test_a_network_runs_on_the_device_that_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert devices(tmp_path, monkeypatch, "cpu", "cpu") == {"cpu"}
    assert devices(tmp_path, monkeypatch, "gpu", "cuda") == {"cuda"}
    for name in ("episodes.parquet", "violations.parquet"):
        assert (tmp_path / "cpu" / name).read_bytes() == (tmp_path / "gpu" / name).read_bytes()


def test_a_network_that_does_not_load_on_it_is_refused_before_the_first_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_DEVICE", "cuda")
    with pytest.raises(InputError, match="cannot be made: RuntimeError: no such device"):
        devices(tmp_path, monkeypatch, "broken", "cuda")
    assert not (tmp_path / "broken").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plant2", "carl-e"])
def test_a_device_that_is_not_there_is_one_line(name: str) -> None:
    import torch  # comes with `make test-slow`

    if torch.cuda.is_available():
        pytest.skip("has a GPU")
    with pytest.raises(InputError, match=r"^device cuda: torch sees no CUDA device here$"):
        tsbench.evaluate([name], split="test", types=("yield",), limit=1, workers=1, device="cuda")
