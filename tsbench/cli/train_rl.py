"""`tsbench train ppo` and `tsbench train carl`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from tsbench.planners.batched import DEVICES


def _options(steps: int, out: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options that both share."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(
            (
                click.option(
                    "--steps", default=steps, show_default=True, type=click.IntRange(min=1),
                    help="Decisions (0.3 s each) in all, those of earlier sittings included.",
                ),
                click.option(
                    "--workers", type=click.IntRange(min=1), metavar="N",
                    help="Processes that drive, one simulation each; default: four per core.",
                ),
                click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0)),
                click.option("--types", default="", metavar="TYPE,GROUP,…", help="Default: all."),
                click.option("--device", type=click.Choice(DEVICES), default="cpu", show_default=True),
                click.option(
                    "--out", type=click.Path(path_type=Path), default=out, show_default=True, metavar="DIR",
                    help="Folder of the training; what it holds of it already is continued.",
                ),
            )
        ):  # fmt: skip
            function = option(function)
        return function

    return add


@click.command()
@_options(steps=3_000_000, out="runs/train-ppo")
def ppo(**options: Any) -> None:
    """PPO on 275 numbers with an MLP; writes ppo.safetensors and ppo.json."""
    _train("ppo", **options)


@click.command()
@_options(steps=1_000_000, out="runs/train-carl")
def carl(**options: Any) -> None:
    """PPO on a bird's-eye raster with a CNN; writes carl.safetensors and carl.json."""
    _train("carl", **options)


def _train(
    planner: str, steps: int, workers: int | None, seed: int, types: str, device: str, out: Path
) -> None:
    from tsbench.learn.rl_config import Job
    from tsbench.learn.rl_train import train  # brings torch

    words = tuple(word.strip() for word in types.split(",") if word.strip())
    count = workers or 4 * len(os.sched_getaffinity(0))
    made = train(Job(planner, out, steps, count, seed, device, words), click.echo)
    click.echo(
        f"weights   {out / made.weights.file} ({made.weights.size / 1e6:.1f} MB, {made.parameters:,} parameters)"
    )
    click.echo(f"facts     {out / planner}.json")
    click.echo(f"curve     tensorboard --logdir {out / 'tensorboard'}")
