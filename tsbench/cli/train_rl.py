"""`tsbench train ppo` and `tsbench train carl`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from tsbench.cli import train_options as share
from tsbench.cli.options import Option, several, words_of
from tsbench.core.machine import own_cores


def _options(steps: int, out: str) -> Option:
    return several(
        click.option(
            "--steps", default=steps, show_default=True, type=click.IntRange(min=1),
            help="Decisions (0.3 s each) in all, those of earlier sittings included.",
        ),
        click.option(
            "--workers", type=click.IntRange(min=1), metavar="N",
            help="Processes that drive, one simulation each; default: four per core.",
        ),
        click.option(
            "--imitation", type=click.IntRange(min=0), metavar="N",
            help="Rollouts of imitation before that, those of earlier sittings included. Default: the planner's.",
        ),
        click.option(
            "--rate", type=click.FloatRange(min=0.0, min_open=True),
            help="Learning rate that this sitting begins with; it falls to a tenth. Default: the planner's.",
        ),
        click.option(
            "--more", default="", metavar="TYPES",
            help="Types and groups drawn three times as often, comma-separated.",
        ),
        share.seed, share.types, share.device, share.out(out),
    )  # fmt: skip


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


def _train(planner: str, workers: int | None, types: str, more: str, out: Path, **options: Any) -> None:
    from tsbench.learn.rl.config import Job
    from tsbench.learn.rl.train import train  # brings torch

    count = workers or 4 * own_cores()
    job = Job(planner, out, workers=count, types=words_of(types), more=words_of(more), **options)
    # Its processes read the rows themselves; what they lack is said before they start.
    share.train_rows(job.types)
    share.tell(out, train(job, click.echo))
