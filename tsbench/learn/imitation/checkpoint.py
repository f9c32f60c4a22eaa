"""The state of a training by imitation: network, optimiser, and how far it is."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from tsbench.learn.checkpoint import (
    STATE,
    load_optimiser,
    optimiser_tensors,
    read_state,
    reading,
    write_state,
)
from tsbench.planners.plant2.network import Plant2Network

_NET = "net."


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
    """`asked`: what a continued training must have in common with this one."""
    tensors = {f"{_NET}{name}": value for name, value in net.state_dict().items()}
    write_state(out, tensors | optimiser_tensors(optimiser), asked, progress=asdict(progress))


def load_checkpoint(
    out: Path, net: Plant2Network, optimiser: torch.optim.AdamW, asked: dict[str, Any]
) -> Progress:
    """Put a saved state back; a fresh `Progress` where there is none.

    Raises InputError for a damaged checkpoint, or one of another training.
    """
    path = out / STATE
    if not path.is_file():
        return Progress()
    with reading(path):
        tensors, facts = read_state(path, asked)
        net.load_state_dict({k.removeprefix(_NET): v for k, v in tensors.items() if k.startswith(_NET)})
        load_optimiser(optimiser, tensors)
        return Progress(**facts["progress"])
