"""`tsbench train plant2`: imitation of sign-blind driving on the train split.

A pass goes over the chunks of frames in a drawn order, in windows whose frames are shuffled together. The state is
kept after each window; what follows hangs on seed, epoch and window alone, so a training that was broken off goes on
as if nothing had been.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from torch.utils.tensorboard import SummaryWriter

from tsbench.errors import InputError
from tsbench.learn.frames_store import FrameStore
from tsbench.learn.imitation_checkpoint import Progress, load_checkpoint, save_checkpoint
from tsbench.learn.imitation_loss import losses, total
from tsbench.learn.imitation_recipe import Place, Recipe, drives_of, validation_rows
from tsbench.learn.imitation_skill import Skill, measure
from tsbench.planners.plant2.inference import tensors
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.network import Plant2Network
from tsbench.planners.weights import Network, network, save_weights
from tsbench.scenarios.seeds import rng_of, seed_of
from tsbench.scenarios.spec import ScenarioSpec

NAME = "plant2"
CURVE = "curve.jsonl"
_WINDOW_CHUNKS = 24
_LOG_EVERY = 20
_SORTED_BATCHES = 16

Integers = npt.NDArray[np.intp]


def train(recipe: Recipe, place: Place, rows: Sequence[ScenarioSpec], tell: Callable[[str], None]) -> Network:
    """Train to the end, from the checkpoint below `place.out` if there is one; the best network is in that folder.

    rows: of the train split. Returns the best network's facts.
    """
    if place.device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: torch sees no CUDA device here")
    place.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(place.workers)
    return Trainer(recipe, place, rows, tell).run()


class Trainer:
    """One sitting of a training."""

    def __init__(
        self, recipe: Recipe, place: Place, rows: Sequence[ScenarioSpec], tell: Callable[[str], None]
    ) -> None:
        self._recipe, self._place, self._tell = recipe, place, tell
        torch.manual_seed(seed_of("imitation", "network", recipe.seed))
        self._net = Plant2Network(recipe.size).to(place.device)
        self._optimiser = torch.optim.AdamW(_groups(self._net, recipe.decay), lr=recipe.rate)
        self._validation = validation_rows(rows, recipe)
        drives = drives_of(rows, recipe)
        if not drives or not self._validation:
            raise InputError("the train split has no scenarios of these types to learn from and to choose by")
        self._made = 0
        self._store = FrameStore(
            place.out / "frames", drives, recipe.sampling, seed=recipe.seed, bound_bytes=place.cache_bytes,
            workers=place.workers, progress=self._driven,
        )  # fmt: skip
        self._facts = {**recipe.facts(), "plan": self._store.plan}
        self._progress = load_checkpoint(place.out, self._net, self._optimiser, self._facts)
        self._began, self._before = time.monotonic(), self._progress

    def run(self) -> Network:
        """All epochs that are left; returns the facts of the best network of all."""
        recipe, out = self._recipe, self._place.out
        if self._progress.steps:
            self._tell(f"continues in epoch {self._progress.epoch + 1} of {recipe.epochs}")
        self._progress = replace(self._progress, sittings=self._progress.sittings + 1)
        with SummaryWriter(str(out / "tensorboard")) as log:
            for epoch in range(self._progress.epoch, recipe.epochs):
                self._epoch(epoch, log)
                self._validate(epoch, log)
        return network(NAME, out)

    def _epoch(self, epoch: int, log: SummaryWriter) -> None:
        order = rng_of("imitation", "chunks", self._recipe.seed, epoch).permutation(len(self._store)).tolist()
        windows = [order[k : k + _WINDOW_CHUNKS] for k in range(0, len(order), _WINDOW_CHUNKS)]
        for number in range(self._progress.window, len(windows)):
            frames = self._store.load(windows[number])
            self._window(epoch, number, len(windows), frames, log)
            self._keep(replace(self._progress, epoch=epoch, window=number + 1))
        self._keep(replace(self._progress, epoch=epoch + 1, window=0))

    def _window(self, epoch: int, number: int, count: int, frames: Records, log: SummaryWriter) -> None:
        """Every frame once, in a drawn order."""
        recipe, net = self._recipe, self._net
        order = rng_of("imitation", "frames", recipe.seed, epoch, number).permutation(len(frames))
        torch.manual_seed(seed_of("imitation", "dropout", recipe.seed, epoch, number))
        net.train()
        batches = batches_of(frames, order, recipe.batch)
        steps, done, began = len(batches), self._progress.steps, time.monotonic()
        sums: dict[str, float] = {}
        for step, rows in enumerate(batches):
            share = (epoch + (number + step / steps) / count) / recipe.epochs
            for group in self._optimiser.param_groups:
                group["lr"] = rate_at(share, recipe)
            batch = {k: v.to(self._place.device) for k, v in trimmed(frames[rows]).items()}
            terms = losses(net(batch), batch)
            loss = total(terms)
            self._optimiser.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(net.parameters(), recipe.clip)
            self._optimiser.step()
            if step % _LOG_EVERY == 0:
                for name, value in terms.items():
                    sums[name] = sums.get(name, 0.0) + value.item()
                    log.add_scalar(f"loss/{name}", value.item(), done + step)
                log.add_scalar("rate", rate_at(share, recipe), done + step)
        self._progress = replace(
            self._progress, steps=done + steps, frames=self._progress.frames + steps * recipe.batch
        )
        logged = max(math.ceil(steps / _LOG_EVERY), 1)
        text = "  ".join(f"{name} {value / logged:.3f}" for name, value in sums.items())
        pace = steps * recipe.batch / max(time.monotonic() - began, 1e-9)
        self._tell(
            f"epoch {epoch + 1}/{recipe.epochs} window {number + 1}/{count}  {text}  {pace:.0f} frames/s"
        )

    def _keep(self, progress: Progress) -> None:
        seconds = self._before.seconds + time.monotonic() - self._began
        self._progress = replace(progress, seconds=seconds)
        save_checkpoint(self._place.out, self._net, self._optimiser, self._progress, self._facts)

    def _validate(self, epoch: int, log: SummaryWriter) -> None:
        """Drive the network of now; it is exported if none before was better."""
        latest = self._export(self._place.out / "latest", None)
        skill = measure(self._place.out / "latest", self._validation, self._place.workers)
        for name, value in asdict(skill).items():
            log.add_scalar(f"skill/{name}", value, self._progress.steps)
        row = {
            "epoch": epoch + 1,
            "frames": self._progress.frames,
            "seconds": round(self._progress.seconds, 1),
        }
        with (self._place.out / CURVE).open("a", encoding="utf-8") as file:
            file.write(json.dumps({**row, **asdict(skill)}) + "\n")
        better = skill.score >= self._progress.best
        if better:
            self._export(self._place.out, skill)
            self._keep(replace(self._progress, best=skill.score, best_epoch=epoch + 1))
        self._tell(
            f"epoch {epoch + 1}: arrived {skill.arrived:.3f}  collision {skill.collision:.3f}  off road "
            f"{skill.off_road:.3f}  timeout {skill.timeout:.3f}  SCD {skill.scd:.3f} on {skill.episodes} episodes"
            f"{'  (best so far)' if better else ''}  weights {latest.weights.sha256[:12]}"
        )

    def _export(self, folder: Path, skill: Skill | None) -> Network:
        arrays = {name: value.detach().cpu().numpy() for name, value in self._net.state_dict().items()}
        training = {
            "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
            **self._facts,
            "epoch": self._progress.epoch,
            "frames": self._progress.frames,
            "minutes": round(self._progress.seconds / 60.0, 1),
            "sittings": self._progress.sittings,
            "device": self._place.device,
            "torch": torch.__version__,
            "validation_skill": None if skill is None else asdict(skill),
        }
        return save_weights(NAME, folder, arrays, training)

    def _driven(self, drives: int) -> None:
        self._made += drives
        seconds = time.monotonic() - self._began
        self._tell(f"{self._made} episodes driven for frames ({seconds:.0f} s since the start)")


def batches_of(frames: Records, order: Integers, size: int) -> list[Integers]:
    """Rows of `frames` in batches, each of frames with about as many objects: the rest of the slots is left out."""
    groups = [order[k : k + _SORTED_BATCHES * size] for k in range(0, len(order), _SORTED_BATCHES * size)]
    batches: list[Integers] = []
    for group in groups:
        counts = np.count_nonzero(frames["kinds"][group], axis=1)
        ranked = group[np.argsort(counts, kind="stable")]
        # The group's own order decides which batch comes when.
        starts = np.argsort(group[: len(group) // size * size : size])
        batches += [ranked[k * size : (k + 1) * size] for k in starts]
    return batches


def trimmed(batch: Records) -> dict[str, torch.Tensor]:
    """Frames as tensors, without the slots that are empty in all of them."""
    slots = max(int(np.count_nonzero(batch["kinds"], axis=1).max()), 1)
    found = tensors(batch, slots)
    for name in ("forecast", "forecast_known"):
        found[name] = found[name][:, :slots]
    return found


def rate_at(share: float, recipe: Recipe) -> float:
    """The learning rate when `share` of the training is done: up in a line, down by a cosine."""
    if share < recipe.warm_up:
        return recipe.rate * (0.01 + 0.99 * share / recipe.warm_up)
    return 0.5 * recipe.rate * (1.0 + math.cos(math.pi * (share - recipe.warm_up) / (1.0 - recipe.warm_up)))


def _groups(net: Plant2Network, decay: float) -> list[dict[str, object]]:
    """Weight decay for matrices, none for biases, norms and queries."""
    named = list(net.named_parameters())
    free = [p for name, p in named if p.ndim < 2 or name == "queries"]
    bound = [p for name, p in named if not (p.ndim < 2 or name == "queries")]
    return [{"params": bound, "weight_decay": decay}, {"params": free, "weight_decay": 0.0}]
