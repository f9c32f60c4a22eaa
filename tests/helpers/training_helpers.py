"""What tests of trainings share: weights that have learned nothing, and a training that is broken off."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from tsbench.learn.imitation.trainer import Trainer
from tsbench.learn.plant2.plant2_network import Plant2FtNetwork, Plant2Network
from tsbench.learn.plant2.plant2_planner import Plant2Blind
from tsbench.learn.plant2.sign_tokens import READER, Vocabulary, vocabulary_of
from tsbench.planners.weights import save_weights


def fresh_tuned(size: str) -> Plant2FtNetwork:
    """A network for the words of tsbench's own `plant2-ft`."""
    return _tuned(size, vocabulary_of())


def fresh_blind(size: str) -> Plant2FtNetwork:
    """A network for these words and posts."""
    return _tuned(size, vocabulary_of().with_posts())


def _tuned(size: str, words: Vocabulary) -> Plant2FtNetwork:
    return Plant2FtNetwork(size, len(words.codes))


def fresh_weights(folder: Path, name: str, kind: Callable[[str], Plant2Network]) -> Path:
    """Save a `mini` network as it begins; returns the folder."""
    torch.manual_seed(1)
    arrays = {key: value.numpy() for key, value in kind("mini").state_dict().items()}
    words = {READER: vocabulary_of(), Plant2Blind.weights: vocabulary_of().with_posts()}
    save_weights(name, folder, arrays, {"size": "mini"}, words[name].metadata() if name in words else None)
    return folder


def break_off(monkeypatch: pytest.MonkeyPatch, training: Callable[[], object]) -> None:
    """Run a training that is interrupted in its fourth window."""
    window, calls = Trainer._window, []

    def breaks(self: Trainer, *arguments: object) -> None:
        calls.append(arguments)
        if len(calls) == 4:
            raise KeyboardInterrupt
        window(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(Trainer, "_window", breaks)
    with pytest.raises(KeyboardInterrupt):
        training()
    monkeypatch.setattr(Trainer, "_window", window)
