"""What all trainings' states on disk are: tensors as safetensors, figures as JSON in their head.

Nothing is pickled; a state is written whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file

from tsbench.core.errors import InputError

SCHEMA_VERSION = 1
STATE = "checkpoint.safetensors"
_ADAM = "adam."

Tensors = dict[str, torch.Tensor]


def write_state(
    out: Path, tensors: Mapping[str, torch.Tensor], job: Mapping[str, Any], **facts: Any
) -> dict[str, Any]:
    """Save below `out`; returns the figures. `job`: what a continued training must have in common with it."""
    told = {"schema_version": SCHEMA_VERSION, "job": job, **facts}
    part = out / f".{STATE}"
    # One file, so that one rename makes tensors and figures valid.
    save_file(
        {k: v.detach().cpu().contiguous() for k, v in tensors.items()},
        part,
        metadata={"facts": json.dumps(told)},
    )
    part.replace(out / STATE)
    return told


def read_state(path: Path, job: Mapping[str, Any]) -> tuple[Tensors, dict[str, Any]]:
    """Tensors and figures. Raises InputError for the state of another training; within `reading`."""
    with safe_open(path, "pt") as file:
        facts: dict[str, Any] = json.loads(file.metadata()["facts"])
    if facts["schema_version"] != SCHEMA_VERSION:
        raise InputError(f"{path}: schema version {facts['schema_version']}, expected {SCHEMA_VERSION}")
    for key, value in job.items():
        old = facts["job"].get(key)
        if old != value:
            raise InputError(f"{path}: is of a training with {key} {old}, not {value}: take another --out")
    return load_file(path), facts


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """What a damaged or foreign state makes torch, JSON or safetensors say becomes one InputError."""
    try:
        yield
    except (SafetensorError, KeyError, ValueError, RuntimeError, TypeError) as error:
        problem = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: is no checkpoint of this training ({problem})") from None


def optimiser_tensors(optimiser: torch.optim.Optimizer) -> Tensors:
    """What an optimiser has learned, by names that `load_optimiser` knows again."""
    return {
        f"{_ADAM}{index}.{name}": value
        for index, state in optimiser.state_dict()["state"].items()
        for name, value in state.items()
    }


def load_optimiser(optimiser: torch.optim.Optimizer, tensors: Mapping[str, torch.Tensor]) -> None:
    """Put it back; rates and the like stay those of the fresh optimiser."""
    state: dict[int, Tensors] = {}
    for key, value in tensors.items():
        if key.startswith(_ADAM):
            _, index, name = key.split(".")
            state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
