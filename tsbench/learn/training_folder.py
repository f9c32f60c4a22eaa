"""What a training keeps in its folder: its state, rows that it writes as it goes, and the learning curve of these.

A state is tensors as safetensors, figures as JSON in their head; nothing is pickled, and it is written whole or not at
all. Rows are a line of JSON each.
"""

from __future__ import annotations

import ctypes
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import nn
from torch.optim import Optimizer

from tsbench.core.errors import InputError
from tsbench.core.files import replacing, write_atomic
from tsbench.planners.base import check_device
from tsbench.report.charts import GREY, INK, save_chart

SCHEMA_VERSION = 2
STATE = "checkpoint.safetensors"
_NET, _ADAM, _GENERATOR = "net.", "adam.", "generator"

Tensors = dict[str, torch.Tensor]


def save_checkpoint(
    out: Path, net: nn.Module, optimiser: Optimizer, job: Mapping[str, Any], progress: Mapping[str, Any]
) -> None:
    """Save network, optimiser and torch's generator below `out`.

    job: what a continued training must have in common with this one. progress: how far it is. Both are for JSON.
    """
    # Parameters, not the state dict: Stable-Baselines3 lists a shared trunk there three times.
    tensors: Tensors = {f"{_NET}{name}": value.detach() for name, value in net.named_parameters()}
    for index, state in optimiser.state_dict()["state"].items():
        tensors |= {f"{_ADAM}{index}.{name}": value for name, value in state.items()}
    tensors[_GENERATOR] = torch.get_rng_state()
    facts = json.dumps({"schema_version": SCHEMA_VERSION, "job": job, "progress": progress})
    # One file, so that one rename makes tensors and figures valid.
    with replacing(out / STATE) as part:
        save_file({k: v.cpu().contiguous() for k, v in tensors.items()}, part, metadata={"facts": facts})


def load_checkpoint(out: Path, net: nn.Module, optimiser: Optimizer, job: Mapping[str, Any]) -> dict[str, Any] | None:
    """Restore a saved state and return its progress, or None without one.

    Raises InputError for a damaged checkpoint, or one of another training.
    """
    path = out / STATE
    if not path.is_file():
        return None
    try:
        with safe_open(path, "pt") as file:
            facts: dict[str, Any] = json.loads(file.metadata()["facts"])
        if facts["schema_version"] != SCHEMA_VERSION:
            raise InputError(f"{path}: schema version {facts['schema_version']}, expected {SCHEMA_VERSION}")
        for key, value in job.items():
            old = facts["job"].get(key)
            if old != value:
                raise InputError(f"{path}: is of a training with {key} {old}, not {value}: take another --out")
        tensors = load_file(path)
        with torch.no_grad():
            for name, parameter in net.named_parameters():
                parameter.copy_(tensors[f"{_NET}{name}"])
        state: dict[int, Tensors] = {}
        for key, tensor in tensors.items():
            if key.startswith(_ADAM):
                _, index, name = key.split(".")
                state.setdefault(int(index), {})[name] = tensor
        # Rates and the like stay those of the fresh optimiser.
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
        torch.set_rng_state(tensors[_GENERATOR])
        progress: dict[str, Any] = facts["progress"]
    except (SafetensorError, KeyError, ValueError, RuntimeError, TypeError) as error:
        problem = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: is no checkpoint of this training ({problem})") from None
    return progress


def keep_freed_memory() -> None:
    """Have glibc reuse large blocks instead of giving them back.

    A batch of rasters is 150 MB, and the kernel clearing fresh pages for it costs more than the convolutions do.
    Other C libraries are left as they are.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        # Of malloc.h: M_MMAP_THRESHOLD, M_TRIM_THRESHOLD.
        libc.mallopt(-3, 2**30)
        libc.mallopt(-1, 2**31 - 1)


def prepare(out: Path, device: str, threads: int) -> None:
    """Make the folder of a training and set torch's threads. InputError where the device is missing."""
    check_device(device)
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(threads)


def command_line() -> str:
    """This process's, as a user would type it; `python -m tsbench` is told as `tsbench`."""
    name = Path(sys.argv[0]).name
    return " ".join(["tsbench" if name == "__main__.py" else name, *sys.argv[1:]])


Row = Mapping[str, float]

# A row per rollout, or per epoch: how the network drives. A row per window of an imitation: means of the losses.
CURVE, LOSSES, PICTURE = "curve.jsonl", "losses.jsonl", "curve.png"
_ENDS = {"arrived": "#0072B2", "collision": "#D55E00", "off_road": "#E69F00", "timeout": GREY}
_TERMS = {"path": INK, "waypoints": "#0072B2", "speed": "#D55E00", "forecast": "#E69F00"}


def add_row(path: Path, row: Row, key: str) -> None:
    """Put a row behind those with a smaller `key`.

    Others go: a training that was broken off wrote them after its last checkpoint.
    """
    kept = [one for one in read_rows(path) if one[key] < row[key]]
    write_atomic(path, "".join(json.dumps(one) + "\n" for one in [*kept, row]).encode())


def read_rows(path: Path) -> list[Row]:
    """The rows of a file; none without a file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return [json.loads(line) for line in lines]


def draw_rl(out: Path) -> None:
    """Ends of the last 200 training episodes and their mean reward over the steps; nothing before the first row."""
    if rows := read_rows(out / CURVE):
        save_chart(lambda: _rl_figure(rows), out / PICTURE)


def _rl_figure(rows: list[Row]) -> Figure:
    steps = [row["steps"] / 1000.0 for row in rows]
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(steps, [row["reward"] for row in rows], color=INK)
    left.set_title("mean reward per episode", loc="left", fontsize="medium")
    for name, colour in _ENDS.items():
        right.plot(steps, [100.0 * row[name] for row in rows], color=colour, label=name.replace("_", " "))
    right.set_title("% of the last 200 episodes", loc="left", fontsize="medium")
    right.set_ylim(0.0, 100.0)
    right.legend(frameon=False, fontsize="small")
    for axes in (left, right):
        axes.set_xlabel("thousand decisions")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_imitation(out: Path) -> None:
    """Write `curve.png`: the losses over the steps, and how the network drives after each epoch."""
    losses, skills = read_rows(out / LOSSES), read_rows(out / CURVE)
    save_chart(lambda: _imitation_figure(losses, skills), out / PICTURE)


def _imitation_figure(losses: list[Row], skills: list[Row]) -> Figure:
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, colour in _TERMS.items():
        rows = [row for row in losses if name in row]
        left.plot([row["steps"] / 1000.0 for row in rows], [row[name] for row in rows], color=colour, label=name)
    left.set(xlabel="thousand steps", yscale="log")
    left.set_title("losses", loc="left", fontsize="medium")
    epochs = [row["epoch"] for row in skills]
    for name, colour in {"scd": INK, **_ENDS}.items():
        label = "SCD" if name == "scd" else name.replace("_", " ")
        right.plot(epochs, [100.0 * row[name] for row in skills], color=colour, marker=".", label=label)
    right.set(xlabel="epoch", ylim=(0.0, 100.0), xticks=epochs)
    right.set_title("% of the episodes on kept-out maps", loc="left", fontsize="medium")
    for axes in (left, right):
        axes.legend(frameon=False, fontsize="small")
        axes.spines[["top", "right"]].set_visible(False)
    return figure
