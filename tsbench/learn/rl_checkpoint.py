"""A training's state on disk: tensors as safetensors, figures as JSON; nothing pickled. Written whole or not at all."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from stable_baselines3 import PPO

from tsbench.errors import InputError

SCHEMA_VERSION = 1
_STATE, _FACTS = "checkpoint.safetensors", "checkpoint.json"


@dataclass(frozen=True, slots=True)
class Progress:
    """steps: decisions taken. seconds: of training so far, all sittings together. sittings: how many there were."""

    steps: int
    seconds: float
    sittings: int


def save_checkpoint(out: Path, model: PPO, progress: Progress, job: dict[str, Any]) -> None:
    """Policy, optimiser and torch's generator; `job`: what a continued training must have in common with this one."""
    # Parameters, not the state dict: Stable-Baselines3 lists a shared trunk there three times.
    tensors: dict[str, torch.Tensor] = {f"policy.{k}": v for k, v in model.policy.named_parameters()}
    for index, state in model.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"adam.{index}.{k}": v for k, v in state.items()}
    tensors["generator"] = torch.get_rng_state()
    tensors = {k: v.detach().cpu().contiguous() for k, v in tensors.items()}
    facts = {
        "schema_version": SCHEMA_VERSION, "job": job, "updates": model._n_updates,
        "steps": progress.steps, "seconds": progress.seconds, "sittings": progress.sittings,
    }  # fmt: skip
    # One rename makes both valid: the tensors carry the figures too.
    temporary = out / f".{_STATE}"
    save_file(tensors, temporary, metadata={"facts": json.dumps(facts)})
    temporary.replace(out / _STATE)
    (out / _FACTS).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def has_checkpoint(out: Path) -> bool:
    """Is there a training to continue?"""
    return (out / _STATE).is_file()


def load_checkpoint(out: Path, model: PPO, job: dict[str, Any]) -> Progress:
    """Put the state back into a fresh model. InputError for a damaged checkpoint, or one of another training."""
    from safetensors import safe_open

    path = out / _STATE
    try:
        with safe_open(path, "pt") as file:
            facts = json.loads(file.metadata()["facts"])
        tensors = load_file(path)
        if facts["schema_version"] != SCHEMA_VERSION:
            raise InputError(f"{path}: schema version {facts['schema_version']}, expected {SCHEMA_VERSION}")
        different = [k for k in job if facts["job"].get(k) != job[k]]
        if different:
            key = different[0]
            raise InputError(
                f"{path}: is of a training with {key} {facts['job'].get(key)}, not {job[key]}: take another --out"
            )
        with torch.no_grad():
            for name, parameter in model.policy.named_parameters():
                parameter.copy_(tensors[f"policy.{name}"])
        model.policy.optimizer.load_state_dict(
            {"state": _adam(tensors), "param_groups": model.policy.optimizer.state_dict()["param_groups"]}
        )
        torch.set_rng_state(tensors["generator"])
        model._n_updates, model.num_timesteps = int(facts["updates"]), int(facts["steps"])
        return Progress(int(facts["steps"]), float(facts["seconds"]), int(facts["sittings"]))
    except (SafetensorError, KeyError, ValueError, RuntimeError, TypeError) as error:
        text = " ".join(str(error).split())
        raise InputError(f"{path}: is no checkpoint of this training ({text[:200]})") from None


def _adam(tensors: dict[str, torch.Tensor]) -> dict[int, dict[str, torch.Tensor]]:
    state: dict[int, dict[str, torch.Tensor]] = {}
    for key, value in tensors.items():
        if key.startswith("adam."):
            _, index, name = key.split(".")
            state.setdefault(int(index), {})[name] = value
    return state


def sitting_seed(seed: int, sitting: int, deaths: int = 0) -> int:
    """What a sitting draws its scenarios from: never those of another again, nor of one whose process died."""
    return int(np.random.SeedSequence((seed, sitting, deaths)).generate_state(1)[0] % 2**31)
