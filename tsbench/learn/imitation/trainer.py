"""Training by imitation: passes over frames of drives, and closed-loop skill after each.

A pass goes over the chunks of frames in a drawn order, in windows whose frames are shuffled together. The state is
kept after each window; what follows hangs on seed, epoch and window alone, so a training that was broken off goes on
as if nothing had been.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.utils.tensorboard import SummaryWriter

from tsbench.core.seeds import rng_of, seed_of
from tsbench.learn.imitation.checkpoint import Progress, load_checkpoint, save_checkpoint
from tsbench.learn.imitation.frames_store import FrameStore
from tsbench.learn.imitation.loss import total
from tsbench.learn.imitation.skill import Skill
from tsbench.learn.start import command_line, prepare
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.network import Plant2Network
from tsbench.planners.plant2.torch_inference import tensors
from tsbench.planners.weights import Network, network, save_weights

CURVE = "curve.jsonl"
_WINDOW_CHUNKS = 24
_LOG_EVERY = 20

Integers = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Place:
    """Where and with what a training runs.

    workers: processes that drive, threads that learn. cache_bytes: bound of the frames on disk.
    """

    out: Path
    device: str
    workers: int
    cache_bytes: int


class Task(Protocol):
    """What is learned: which network, from which frames, and how it is judged."""

    @property
    def name(self) -> str:
        """Of the network, as it is exported."""

    @property
    def epochs(self) -> int:
        """Passes over the frames."""

    @property
    def seed(self) -> int:
        """Of order and dropout."""

    @property
    def clip(self) -> float:
        """Greatest norm of a gradient."""

    def facts(self) -> dict[str, Any]:
        """What a training that is continued must have in common with the one before, for JSON."""

    def network(self) -> Plant2Network:
        """The network to begin with."""

    def groups(self, net: Plant2Network) -> list[dict[str, Any]]:
        """AdamW's groups of parameters; `share`: of the learning rate, 1 where there is none."""

    def store(self, place: Place, progress: Callable[[int], None]) -> FrameStore:
        """The frames."""

    def batches(self, frames: Records, order: Integers) -> list[Integers]:
        """Rows of frames in batches; order: of all rows, drawn."""

    def losses(self, net: Plant2Network, batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """The terms of a batch's loss, by names of `imitation_loss.WEIGHTS`."""

    def rate_at(self, share: float) -> float:
        """The learning rate when `share` of the training is done."""

    def measure(self, folder: Path, workers: int) -> Skill:
        """Closed-loop skill of the network that was exported to a folder."""

    def score(self, skill: Skill) -> float:
        """What the best checkpoint has most of; not below -1."""


def train(task: Task, place: Place, tell: Callable[[str], None]) -> Network:
    """Train to the end, from the checkpoint below `place.out` if there is one; the best network is in that folder.

    Returns the best network's facts.
    """
    prepare(place.out, place.device, place.workers)
    if place.device == "cuda":
        # Products in TF32: several times faster, and a step's own noise is larger than its rounding.
        torch.set_float32_matmul_precision("high")
    return Trainer(task, place, tell).run()


class Trainer:
    """One sitting of a training."""

    def __init__(self, task: Task, place: Place, tell: Callable[[str], None]) -> None:
        self._task, self._place, self._tell = task, place, tell
        torch.manual_seed(seed_of("imitation", "network", task.seed))
        self._net = task.network().to(place.device)
        self._optimiser = torch.optim.AdamW(task.groups(self._net))
        self._made = 0
        self._store = task.store(place, self._driven)
        self._facts = {**task.facts(), "plan": self._store.plan}
        self._progress = load_checkpoint(place.out, self._net, self._optimiser, self._facts)
        self._began, self._before = time.monotonic(), self._progress

    def run(self) -> Network:
        """All epochs that are left; returns the facts of the best network of all."""
        epochs, out = self._task.epochs, self._place.out
        if self._progress.steps:
            self._tell(f"continues in epoch {self._progress.epoch + 1} of {epochs}")
        self._progress = replace(self._progress, sittings=self._progress.sittings + 1)
        with SummaryWriter(str(out / "tensorboard")) as log:
            for epoch in range(self._progress.epoch, epochs):
                self._epoch(epoch, log)
                self._validate(epoch, log)
        return network(self._task.name, out)

    def _epoch(self, epoch: int, log: SummaryWriter) -> None:
        order = rng_of("imitation", "chunks", self._task.seed, epoch).permutation(len(self._store)).tolist()
        windows = [order[k : k + _WINDOW_CHUNKS] for k in range(0, len(order), _WINDOW_CHUNKS)]
        for number in range(self._progress.window, len(windows)):
            frames = self._store.load(windows[number])
            self._window(epoch, number, len(windows), frames, log)
            self._keep(replace(self._progress, epoch=epoch, window=number + 1))
        self._keep(replace(self._progress, epoch=epoch + 1, window=0))

    def _window(self, epoch: int, number: int, count: int, frames: Records, log: SummaryWriter) -> None:
        """Every frame once, in a drawn order."""
        task, net = self._task, self._net
        order = rng_of("imitation", "frames", task.seed, epoch, number).permutation(len(frames))
        torch.manual_seed(seed_of("imitation", "dropout", task.seed, epoch, number))
        net.train()
        batches = task.batches(frames, order)
        steps, done, began = len(batches), self._progress.steps, time.monotonic()
        seen = sum(len(rows) for rows in batches)
        sums: dict[str, float] = {}
        for step, rows in enumerate(batches):
            rate = task.rate_at((epoch + (number + step / steps) / count) / task.epochs)
            for group in self._optimiser.param_groups:
                group["lr"] = rate * group.get("share", 1.0)
            batch = {k: v.to(self._place.device) for k, v in trimmed(frames[rows]).items()}
            terms = task.losses(net, batch)
            loss = total(terms)
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(net.parameters(), task.clip)
            self._optimiser.step()
            if step % _LOG_EVERY == 0:
                for name, value in terms.items():
                    sums[name] = sums.get(name, 0.0) + value.item()
                    log.add_scalar(f"loss/{name}", value.item(), done + step)
                log.add_scalar("rate", rate, done + step)
        self._progress = replace(self._progress, steps=done + steps, frames=self._progress.frames + seen)
        logged = max(math.ceil(steps / _LOG_EVERY), 1)
        text = "  ".join(f"{name} {value / logged:.3f}" for name, value in sums.items())
        pace = seen / max(time.monotonic() - began, 1e-9)
        self._tell(
            f"epoch {epoch + 1}/{task.epochs} window {number + 1}/{count}  {text}  {pace:.0f} frames/s"
        )

    def _keep(self, progress: Progress) -> None:
        seconds = self._before.seconds + time.monotonic() - self._began
        self._progress = replace(progress, seconds=seconds)
        save_checkpoint(self._place.out, self._net, self._optimiser, self._progress, self._facts)

    def _validate(self, epoch: int, log: SummaryWriter) -> None:
        """Drive the network of now; it is exported if none before was better."""
        latest = self._export(self._place.out / "latest", None)
        skill = self._task.measure(self._place.out / "latest", self._place.workers)
        score = self._task.score(skill)
        for name, value in asdict(skill).items():
            log.add_scalar(f"skill/{name}", value, self._progress.steps)
        row = {
            "epoch": epoch + 1,
            "frames": self._progress.frames,
            "seconds": round(self._progress.seconds, 1),
        }
        with (self._place.out / CURVE).open("a", encoding="utf-8") as file:
            file.write(json.dumps({**row, **asdict(skill)}) + "\n")
        better = score >= self._progress.best
        if better:
            self._export(self._place.out, skill)
            self._keep(replace(self._progress, best=score, best_epoch=epoch + 1))
        self._tell(
            f"epoch {epoch + 1}: arrived {skill.arrived:.3f}  collision {skill.collision:.3f}  off road "
            f"{skill.off_road:.3f}  timeout {skill.timeout:.3f}  SCD {skill.scd:.3f} on {skill.episodes} episodes"
            f"{'  (best so far)' if better else ''}  weights {latest.weights.sha256[:12]}"
        )

    def _export(self, folder: Path, skill: Skill | None) -> Network:
        arrays = {name: value.detach().cpu().numpy() for name, value in self._net.state_dict().items()}
        training = {
            "command": command_line(),
            **self._facts,
            "epoch": self._progress.epoch,
            "frames": self._progress.frames,
            "minutes": round(self._progress.seconds / 60.0, 1),
            "sittings": self._progress.sittings,
            "device": self._place.device,
            "torch": torch.__version__,
            "validation_skill": None if skill is None else asdict(skill),
        }
        return save_weights(self._task.name, folder, arrays, training)

    def _driven(self, drives: int) -> None:
        self._made += drives
        seconds = time.monotonic() - self._began
        self._tell(f"{self._made} episodes driven for frames ({seconds:.0f} s since the start)")


def trimmed(batch: Records) -> dict[str, Tensor]:
    """Frames as tensors, without the slots that are empty in all of them."""
    slots = max(int(np.count_nonzero(batch["kinds"], axis=1).max()), 1)
    found = tensors(batch, slots)
    for name in ("forecast", "forecast_known"):
        if name in found:
            found[name] = found[name][:, :slots]
    return found
