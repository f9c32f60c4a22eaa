"""`tsbench train plant2-ft` and `tsbench train frames`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tsbench.cli import train_options as share
from tsbench.cli.options import Option, several, words_of
from tsbench.core.machine import own_cores

if TYPE_CHECKING:
    from tsbench.learn.finetune.recipe import FineTuning
    from tsbench.scenarios.spec import ScenarioSpec


def _lessons(drives: int, out: str) -> Option:
    """The options that say which drives are learned from, and with what."""
    return several(
        click.option(
            "--trajectories", type=click.Path(path_type=Path), metavar="FILE",
            help="The oracle's drives; default: those of the data folder.",
        ),
        click.option(
            "--driver", "drivers", multiple=True, metavar="PLANNER",
            help="Drive anew instead, with this expert; several take turns.",
        ),
        click.option(
            "--drives", default=drives, show_default=True, type=click.IntRange(min=0),
            help="To learn from, types in turn; 0: all.",
        ),
        click.option(
            "--more", default="", metavar="TYPES",
            help="Types and groups that have three drives a turn, comma-separated.",
        ),
        click.option(
            "--student", type=share.FOLDER, metavar="DIR",
            help="Folder of plant2-ft's weights that begin a share of the drives; --expert ends them.",
        ),
        click.option(
            "--takeover", default=0.3, show_default=True, type=click.FloatRange(0.0, 1.0), help="That share."
        ),
        click.option("--expert", default="idm-e", show_default=True, metavar="PLANNER"),
        share.types, share.seed, share.workers, share.cache_gb, share.out(out),
    )  # fmt: skip


@click.command()
@click.option(
    "--base", type=share.FOLDER, metavar="DIR",
    help="Folder of the plant2 or plant2-ft weights to begin with; default: tsbench's own plant2.",
)  # fmt: skip
@click.option(
    "--epochs", default=26, show_default=True, type=click.IntRange(min=1), help="Passes over their frames."
)
@click.option("--batch", default=128, show_default=True, type=click.IntRange(min=8))
@click.option("--rate", default=1e-4, show_default=True, type=click.FloatRange(min=0.0, min_open=True))
@click.option(
    "--validation", default=58, show_default=True, type=click.IntRange(min=1),
    help="Episodes driven after each epoch; the network with most SCD is kept.",
)  # fmt: skip
@share.device
@_lessons(drives=0, out="runs/train-plant2-ft")
def plant2_ft(
    base: Path | None, epochs: int, batch: int, rate: float, validation: int, device: str, workers: int | None,
    cache_gb: float, out: Path, **lessons: Any,
) -> None:  # fmt: skip
    """Fine-tuning of plant2 on obedient drives; writes plant2-ft.safetensors and plant2-ft.json."""
    from tsbench.learn.finetune.task import FinetuneTask  # brings torch
    from tsbench.learn.imitation.trainer import Place, train

    recipe, rows = _recipe(base=base, epochs=epochs, batch=batch, rate=rate, validation=validation, **lessons)
    place = Place(out, device, workers or own_cores(), int(cache_gb * 1e9))
    share.tell(out, train(FinetuneTask(recipe, rows), place, click.echo))


@click.command()
@_lessons(drives=290, out="runs/frames")
def frames(workers: int | None, cache_gb: float, out: Path, **lessons: Any) -> None:
    """What plant2-ft is shown: counts, targets, and ten frames of each group as pictures."""
    from tsbench.learn.finetune.recipe import lessons_of
    from tsbench.learn.finetune.report import report

    recipe, rows = _recipe(**lessons)
    workers = workers or own_cores()
    for path in report(lessons_of(rows, recipe), recipe, out, workers, int(cache_gb * 1e9), click.echo):
        click.echo(path)


def _recipe(
    types: str, more: str, trajectories: Path | None, **options: Any
) -> tuple[FineTuning, list[ScenarioSpec]]:
    from tsbench.learn.finetune.recipe import FineTuning
    from tsbench.learn.oracle.trajectories import trajectories_path

    words, often = words_of(types), share.types_of(words_of(more))
    path = trajectories or trajectories_path()
    return FineTuning(trajectories=path, types=words, more=often, **options), share.train_rows(words)
