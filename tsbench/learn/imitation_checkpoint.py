"""A training's state on disk: tensors as safetensors, figures as JSON in their head; nothing pickled, written whole."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file

from tsbench.errors import InputError
from tsbench.planners.plant2.network import Plant2Network

SCHEMA_VERSION = 1
_STATE = "checkpoint.safetensors"


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a training is: epoch and window come next. best: greatest skill so far, `best_epoch` after that many.

    seconds, frames: trained so far, all sittings together.
    """

    epoch: int = 0
    window: int = 0
    steps: int = 0
    frames: int = 0
    seconds: float = 0.0
    best: float = -2.0
    best_epoch: int = 0
    sittings: int = 0


def save_checkpoint(
    out: Path, net: Plant2Network, optimiser: torch.optim.AdamW, progress: Progress, asked: dict[str, Any]
) -> None:
    """Network, optimiser and progress; `asked`: what a continued training must have in common with this one."""
    tensors = {f"net.{name}": value for name, value in net.state_dict().items()}
    for index, state in optimiser.state_dict()["state"].items():
        tensors |= {f"adam.{index}.{name}": value for name, value in state.items()}
    tensors = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    facts = {"schema_version": SCHEMA_VERSION, "asked": asked, "progress": asdict(progress)}
    part = out / f".{_STATE}.part"
    save_file(tensors, part, metadata={"facts": json.dumps(facts)})
    part.replace(out / _STATE)


def load_checkpoint(
    out: Path, net: Plant2Network, optimiser: torch.optim.AdamW, asked: dict[str, Any]
) -> Progress:
    """Put a saved state back; a fresh `Progress` where there is none.

    Raises InputError for a damaged checkpoint, or one of another training.
    """
    path = out / _STATE
    if not path.is_file():
        return Progress()
    try:
        with safe_open(path, "pt") as file:
            facts = json.loads(file.metadata()["facts"])
        if facts["schema_version"] != SCHEMA_VERSION:
            raise InputError(f"{path}: schema version {facts['schema_version']}, expected {SCHEMA_VERSION}")
        for key, value in asked.items():
            if facts["asked"].get(key) != value:
                old = facts["asked"].get(key)
                raise InputError(
                    f"{path}: is of a training with {key} {old}, not {value}: take another --out"
                )
        tensors = load_file(path)
        net.load_state_dict({k.removeprefix("net."): v for k, v in tensors.items() if k.startswith("net.")})
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, value in tensors.items():
            if key.startswith("adam."):
                _, index, name = key.split(".")
                state.setdefault(int(index), {})[name] = value
        groups = optimiser.state_dict()["param_groups"]
        optimiser.load_state_dict({"state": state, "param_groups": groups})
        return Progress(**facts["progress"])
    except (SafetensorError, KeyError, ValueError, RuntimeError, TypeError) as error:
        problem = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: is no checkpoint of this training ({problem})") from None
