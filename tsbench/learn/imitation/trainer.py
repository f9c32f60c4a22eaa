"""Training by imitation: passes over frames of drives, and closed-loop skill after each.

A pass goes over the chunks of frames in a drawn order, in windows whose frames are shuffled together. The state is
kept each minute and after each window; what follows depends on it, the seed and the resources in the passes alone, so a
training that was broken off goes on as if nothing had been.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional
from torch.utils.tensorboard import SummaryWriter

from tsbench.core.seeds import rng_of, seed_of
from tsbench.learn.imitation.frames_store import FrameStore, TrainingResources
from tsbench.learn.imitation.recipe import Skill, TrainingRecipe, measure
from tsbench.learn.imitation.task import ImitationTask
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_network import NetworkPlan, Plant2Network, tensors
from tsbench.learn.plant2.tokens import Records
from tsbench.learn.training_folder import (
    CURVE,
    LOSSES,
    add_row,
    command_line,
    draw_imitation,
    load_checkpoint,
    prepare,
    save_checkpoint,
)
from tsbench.planners.weights import Network, network, save_weights

# So that no term drowns the others: a good path is wrong by centimetres, a good speed still by a quarter of a nat.
WEIGHTS = {"path": 1.0, "waypoints": 0.5, "speed": 0.5, "forecast": 0.2}


def two_hot(speed: Tensor) -> Tensor:
    """(b,) m/s to (b, 8): the weight is shared by the two classes around it, so that their mean is the speed."""
    classes = torch.tensor(at.SPEEDS, device=speed.device)
    v = speed.clamp(at.SPEEDS[0], at.SPEEDS[-1])
    upper = torch.searchsorted(classes, v, right=True).clamp(1, len(at.SPEEDS) - 1)
    share = (v - classes[upper - 1]) / (classes[upper] - classes[upper - 1])
    rows = torch.arange(len(v), device=v.device)
    target = torch.zeros((len(v), len(at.SPEEDS)), device=v.device)
    target[rows, upper - 1] = 1.0 - share
    target[rows, upper] = share
    return target


def losses(plan: NetworkPlan, frames: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Each term, unweighted; means over what is known. Forecasts only where the plan has them."""
    terms = {
        "path": _l1(plan.path, frames["path"], frames["path_known"]),
        "waypoints": _l1(plan.waypoints, frames["waypoints"], frames["waypoints_known"]),
        "speed": functional.cross_entropy(plan.speed, two_hot(frames["speed"])),
    }
    if plan.forecast is not None:
        terms["forecast"] = _l1(plan.forecast, frames["forecast"], frames["forecast_known"])
    return terms


def total(terms: Mapping[str, Tensor]) -> Tensor:
    return torch.stack([WEIGHTS[name] * value for name, value in terms.items()]).sum()


def _l1(found: Tensor, wanted: Tensor, known: Tensor) -> Tensor:
    weight = known.to(found.dtype)
    return ((found - wanted).abs().mean(-1) * weight).sum() / weight.sum().clamp_min(1.0)


_WINDOW_CHUNKS = 24
_LOG_EVERY = 20
_KEEP_EVERY_S = 60.0


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a training is: epoch, window and batch of the window come next.

    steps, frames: of whole windows. best: greatest score so far, `best_epoch` after that many. seconds: trained so far,
    all sessions together.
    """

    epoch: int = 0
    window: int = 0
    batch: int = 0
    steps: int = 0
    frames: int = 0
    seconds: float = 0.0
    best: float = -2.0
    best_epoch: int = 0
    sessions: int = 0


def train(task: ImitationTask, resources: TrainingResources, tell: Callable[[str], None]) -> Network:
    """Train to the end, from the checkpoint below `resources.out` if there is one; the best network is in that folder.

    Returns the best network's facts.
    """
    prepare(resources.out, resources.device, resources.workers)
    if resources.device == "cuda":
        # Products in TF32: several times faster, and a step's own noise is larger than its rounding.
        torch.set_float32_matmul_precision("high")
    return Trainer(task, resources, tell).run()


class Trainer:
    def __init__(self, task: ImitationTask, resources: TrainingResources, tell: Callable[[str], None]) -> None:
        self._task, self._resources, self._tell = task, resources, tell
        torch.manual_seed(seed_of("imitation", "network", task.recipe.seed))
        self._net = task.network().to(resources.device)
        self._optimiser = torch.optim.AdamW(parameter_groups(self._net, task))
        self._made = 0
        self._store = FrameStore(resources, task.drives, task.source, task.recipe.seed, self._driven)
        self._facts = {**task.recipe.facts(), "plan": self._store.plan}
        known = load_checkpoint(resources.out, self._net, self._optimiser, self._facts)
        self._progress = Progress(**(known or {}))
        self._generator = torch.get_rng_state()
        self._began = self._kept = time.monotonic()
        self._before = self._progress

    def run(self) -> Network:
        epochs, out = self._task.recipe.epochs, self._resources.out
        if self._progress.seconds:
            self._tell(f"continues in epoch {self._progress.epoch + 1} of {epochs}")
        self._progress = replace(self._progress, sessions=self._progress.sessions + 1)
        with SummaryWriter(str(out / "tensorboard")) as log:
            for epoch in range(self._progress.epoch, epochs):
                self._epoch(epoch, log)
                self._validate(epoch, log)
        return network(self._task.name, out)

    def _epoch(self, epoch: int, log: SummaryWriter) -> None:
        order = rng_of("imitation", "chunks", self._task.recipe.seed, epoch).permutation(len(self._store)).tolist()
        windows = [order[k : k + _WINDOW_CHUNKS] for k in range(0, len(order), _WINDOW_CHUNKS)]
        for number in range(self._progress.window, len(windows)):
            self._progress = replace(self._progress, epoch=epoch, window=number)
            frames = self._store.load(windows[number])
            self._window(epoch, number, len(windows), frames, log)
            self._keep(replace(self._progress, window=number + 1, batch=0))

    def _window(self, epoch: int, number: int, count: int, frames: Records, log: SummaryWriter) -> None:
        """Every frame once, in a drawn order; from the batch on that the progress names."""
        task, net, first = self._task, self._net, self._progress.batch
        order = rng_of("imitation", "frames", task.recipe.seed, epoch, number).permutation(len(frames))
        torch.manual_seed(seed_of("imitation", "dropout", task.recipe.seed, epoch, number))
        if first:
            torch.set_rng_state(self._generator)
        net.train()
        batches = task.batches(frames, order)
        steps, done, began = len(batches), self._progress.steps, time.monotonic()
        sums: dict[str, float] = {}
        logged = 0
        for step, rows in list(enumerate(batches))[first:]:
            rate = rate_at((epoch + (number + step / steps) / count) / task.recipe.epochs, task.recipe)
            for group in self._optimiser.param_groups:
                group["lr"] = rate * group["share"]
            batch = {k: v.to(self._resources.device) for k, v in trimmed(frames[rows]).items()}
            terms = losses(net(batch, forecast="forecast" in batch), batch)
            loss = total(terms)
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(net.parameters(), task.recipe.clip)
            self._optimiser.step()
            if step % _LOG_EVERY == 0:
                logged += 1
                for name, value in terms.items():
                    sums[name] = sums.get(name, 0.0) + value.item()
                    log.add_scalar(f"loss/{name}", value.item(), done + step)
                log.add_scalar("rate", rate, done + step)
            if time.monotonic() - self._kept >= _KEEP_EVERY_S:
                self._keep(replace(self._progress, batch=step + 1))
                self._say(epoch, number, count, f"batch {step + 1}/{steps}  loss {loss.item():.3f}")
        seen = sum(len(rows) for rows in batches)
        self._progress = replace(self._progress, steps=done + steps, frames=self._progress.frames + seen)
        means = {name: round(value / logged, 4) for name, value in sums.items()}
        if means:
            add_row(self._resources.out / LOSSES, {"steps": self._progress.steps, **means}, "steps")
        pace = sum(len(rows) for rows in batches[first:]) / max(time.monotonic() - began, 1e-9)
        text = "  ".join(f"{name} {value:.3f}" for name, value in means.items())
        self._say(epoch, number, count, f"{text}  {pace:.0f} frames/s")

    def _say(self, epoch: int, number: int, count: int, text: str) -> None:
        self._tell(f"epoch {epoch + 1}/{self._task.recipe.epochs} window {number + 1}/{count}  {text}")

    def _keep(self, progress: Progress) -> None:
        self._kept = time.monotonic()
        self._progress = replace(progress, seconds=self._before.seconds + self._kept - self._began)
        save_checkpoint(self._resources.out, self._net, self._optimiser, self._facts, asdict(self._progress))

    def _validate(self, epoch: int, log: SummaryWriter) -> None:
        """Drive the network of now; it is exported if none before was better. Only then the epoch is over."""
        self._progress = replace(self._progress, epoch=epoch + 1, window=0)
        out, rows = self._resources.out, self._task.validation
        latest = self._export(out / "latest", None)
        self._tell(f"epoch {epoch + 1}: drives {len(rows)} episodes on kept-out maps")
        skill = measure(self._task.name, out / "latest", rows, self._resources.workers)
        score = self._task.score(skill)
        for name, value in asdict(skill).items():
            log.add_scalar(f"skill/{name}", value, self._progress.steps)
        row = {"epoch": epoch + 1, "frames": self._progress.frames, "seconds": round(self._progress.seconds, 1)}
        add_row(out / CURVE, {**row, **asdict(skill)}, "epoch")
        draw_imitation(out)
        better = score >= self._progress.best
        if better:
            self._export(out, skill)
            self._progress = replace(self._progress, best=score, best_epoch=epoch + 1)
        self._keep(self._progress)
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
            "sessions": self._progress.sessions,
            "device": self._resources.device,
            "torch": torch.__version__,
            "validation_skill": None if skill is None else asdict(skill),
        }
        return save_weights(self._task.name, folder, arrays, training, self._task.metadata)

    def _driven(self, drives: int) -> None:
        self._made += drives
        seconds = time.monotonic() - self._began
        self._tell(f"{self._made} episodes driven for frames ({seconds:.0f} s since the start)")


def parameter_groups(net: Plant2Network, task: ImitationTask) -> list[dict[str, Any]]:
    """AdamW's groups: `share` of the rate by parameter, weight decay for matrices alone."""
    found: dict[tuple[float, float], list[Any]] = {}
    for name, parameter in net.named_parameters():
        decay = 0.0 if parameter.ndim < 2 or name == "queries" else task.recipe.decay
        found.setdefault((task.share(name), decay), []).append(parameter)
    return [{"params": p, "share": share, "weight_decay": decay} for (share, decay), p in found.items()]


def rate_at(share: float, recipe: TrainingRecipe) -> float:
    """The learning rate when `share` of the training is done: up in a line, down by a cosine."""
    if share < recipe.warm_up:
        return recipe.rate * (0.01 + 0.99 * share / recipe.warm_up)
    return 0.5 * recipe.rate * (1.0 + math.cos(math.pi * (share - recipe.warm_up) / (1.0 - recipe.warm_up)))


def trimmed(batch: Records) -> dict[str, Tensor]:
    """Frames as tensors, without the slots that are empty in all of them."""
    slots = max(int(np.count_nonzero(batch["kinds"], axis=1).max()), 1)
    found = tensors(batch, slots)
    for name in ("forecast", "forecast_known"):
        if name in found:
            found[name] = found[name][:, :slots]
    return found
