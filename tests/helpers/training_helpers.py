"""What tests of trainings share: weights that have learned nothing, and frames of straight driving."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from tsbench.learn.imitation.frames_store import TrainingResources
from tsbench.learn.plant2 import tokens as at
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


def straight_frames(count: int, dtype: np.dtype, seed: int = 0) -> at.Records:
    """Frames of straight driving among a few cars."""
    rng = np.random.default_rng(seed)
    frames: at.Records = np.zeros(count, dtype=dtype)
    for k in range(count):
        n = int(rng.integers(0, 12))
        frames["kinds"][k, :n] = at.CAR
        frames["objects"][k, :n] = rng.normal(size=(n, at.OBJECT_FEATURES))
    frames["path"][..., 0] = np.arange(1, 21)
    frames["path_known"] = 1
    frames["route"] = frames["path"] / at.POSITION_SCALE_M
    return frames


def store_frames(place: TrainingResources, plan: str, chunks: list[at.Records]) -> TrainingResources:
    """Where a training finds its frames made already."""
    folder = place.out / "frames" / plan
    folder.mkdir(parents=True, exist_ok=True)
    for number, frames in enumerate(chunks):
        np.save(folder / f"chunk-{number:05d}.npy", frames)
    return place
