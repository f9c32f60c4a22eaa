"""The state of a training by PPO: policy, optimiser, torch's generator, and how far it is."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from tsbench.learn.checkpoint import (
    STATE,
    load_optimiser,
    optimiser_tensors,
    read_state,
    reading,
    write_state,
)

_FACTS = "checkpoint.json"


@dataclass(frozen=True, slots=True)
class Progress:
    """steps: decisions taken since imitation. seconds: of training so far, all sittings together. sittings: how many
    there were. imitated: rollouts of imitation.
    """

    steps: int
    seconds: float
    sittings: int
    imitated: int


def save_checkpoint(out: Path, model: PPO, progress: Progress, job: dict[str, Any]) -> None:
    """`job`: what a continued training must have in common with this one."""
    # Parameters, not the state dict: Stable-Baselines3 lists a shared trunk there three times.
    tensors: dict[str, torch.Tensor] = {f"policy.{k}": v for k, v in model.policy.named_parameters()}
    tensors |= optimiser_tensors(model.policy.optimizer)
    tensors["generator"] = torch.get_rng_state()
    told = write_state(out, tensors, job, updates=model._n_updates, **asdict(progress))
    (out / _FACTS).write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def has_checkpoint(out: Path) -> bool:
    """Is there a training to continue?"""
    return (out / STATE).is_file()


def load_checkpoint(out: Path, model: PPO, job: dict[str, Any]) -> Progress:
    """Put the state back into a fresh model. InputError for a damaged checkpoint, or one of another training."""
    path = out / STATE
    with reading(path):
        tensors, facts = read_state(path, job)
        with torch.no_grad():
            for name, parameter in model.policy.named_parameters():
                parameter.copy_(tensors[f"policy.{name}"])
        load_optimiser(model.policy.optimizer, tensors)
        torch.set_rng_state(tensors["generator"])
        model._n_updates, model.num_timesteps = int(facts["updates"]), int(facts["steps"])
        counts = (int(facts[name]) for name in ("sittings", "imitated"))
        return Progress(int(facts["steps"]), float(facts["seconds"]), *counts)


def sitting_seed(seed: int, sitting: int, deaths: int = 0) -> int:
    """What a sitting draws its scenarios from: never those of another again, nor of one whose process died."""
    return int(np.random.SeedSequence((seed, sitting, deaths)).generate_state(1)[0] % 2**31)
