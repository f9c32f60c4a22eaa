"""Weights: written, described, checked before use."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.planners import weights
from tsbench.planners.weights import load_weights, network, save_weights

TENSORS = {"b": np.arange(6, dtype=np.float32).reshape(2, 3), "a": np.ones(4, dtype=np.float32)}


def test_what_is_saved_is_loaded(tmp_path: Path) -> None:
    facts = save_weights("net", tmp_path, TENSORS, {"seed": 3})
    assert network("net", tmp_path) == facts
    assert facts.parameters == 10
    assert facts.training == {"seed": 3}
    loaded = load_weights("net", tmp_path)
    assert sorted(loaded) == ["a", "b"]
    assert all(np.array_equal(loaded[key], TENSORS[key]) for key in TENSORS)


def test_the_same_tensors_are_the_same_file(tmp_path: Path) -> None:
    one = save_weights("net", tmp_path / "one", TENSORS, {})
    other = save_weights("net", tmp_path / "two", dict(reversed(TENSORS.items())), {})
    assert one.weights.sha256 == other.weights.sha256


def test_a_damaged_file_is_one_line(tmp_path: Path) -> None:
    save_weights("net", tmp_path, TENSORS, {})
    file = tmp_path / "net.safetensors"
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    file.write_bytes(content)
    with one_line(match=r"net\.safetensors: is damaged"):
        load_weights("net", tmp_path)


@pytest.mark.parametrize("missing", ["net.json", "net.safetensors"])
def test_a_missing_file_is_one_line(tmp_path: Path, missing: str) -> None:
    save_weights("net", tmp_path, TENSORS, {})
    (tmp_path / missing).unlink()
    with one_line(match=missing):
        load_weights("net", tmp_path)


def test_a_foreign_description_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "net.json").write_text('{"schema_version": 1, "file": "x"}')
    with pytest.raises(InputError, match="does not describe weights"):
        network("net", tmp_path)


def test_a_file_from_elsewhere_is_fetched_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = tmp_path / "cache"
    monkeypatch.setattr(weights.platformdirs, "user_cache_dir", lambda name: str(cache))
    save_weights("net", tmp_path / "made", TENSORS, {})
    there, here = tmp_path / "made" / "net.safetensors", tmp_path / "net.json"
    facts = json.loads((tmp_path / "made" / "net.json").read_text())
    here.write_text(json.dumps(facts | {"source": str(there)}))
    assert len(load_weights("net", tmp_path)) == 2
    there.unlink()
    assert len(load_weights("net", tmp_path)) == 2
    (cache / "weights" / "net.safetensors").unlink()
    with pytest.raises(InputError, match="cannot be fetched"):
        load_weights("net", tmp_path)
