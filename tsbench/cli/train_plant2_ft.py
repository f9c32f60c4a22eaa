"""`tsbench train plant2-ft` and `tsbench train frames`."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tsbench.planners.batched import DEVICES

if TYPE_CHECKING:
    from tsbench.learn.finetune_recipe import FineTuning
    from tsbench.scenarios.spec import ScenarioSpec

_FOLDER = click.Path(path_type=Path, file_okay=False)


def _lessons(drives: int, out: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options that say which drives are learned from, and with what."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(
            (
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
                    "--student", type=_FOLDER, metavar="DIR",
                    help="Folder of plant2-ft's weights that begin a share of the drives; --expert ends them.",
                ),
                click.option(
                    "--takeover", default=0.3, show_default=True, type=click.FloatRange(0.0, 1.0), help="That share."
                ),
                click.option("--expert", default="idm-e", show_default=True, metavar="PLANNER"),
                click.option("--types", default="", metavar="TYPE,GROUP,…", help="Default: all."),
                click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0)),
                click.option(
                    "--workers", type=click.IntRange(min=1), metavar="N",
                    help="Processes that drive, threads that learn; default: one per core.",
                ),
                click.option(
                    "--cache-gb", default=8.0, show_default=True, type=click.FloatRange(min=0.1),
                    help="Bound of frames on disk.",
                ),
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
@click.option(
    "--base", type=_FOLDER, metavar="DIR",
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
@click.option("--device", type=click.Choice(DEVICES), default="cpu", show_default=True)
@_lessons(drives=0, out="runs/train-plant2-ft")
def plant2_ft(
    base: Path | None, epochs: int, batch: int, rate: float, validation: int, device: str, workers: int | None,
    cache_gb: float, out: Path, **lessons: Any,
) -> None:  # fmt: skip
    """Fine-tuning of plant2 on obedient drives; writes plant2-ft.safetensors and plant2-ft.json."""
    from tsbench.learn.finetune import Obedience  # brings torch
    from tsbench.learn.trainer import Place, train

    recipe, rows = _recipe(base=base, epochs=epochs, batch=batch, rate=rate, validation=validation, **lessons)
    place = Place(out, device, workers or len(os.sched_getaffinity(0)), int(cache_gb * 1e9))
    made = train(Obedience(recipe, rows), place, click.echo)
    weights = f"{made.weights.size / 1e6:.1f} MB, {made.parameters:,} parameters"
    click.echo(f"weights   {out / made.weights.file} ({weights})")
    click.echo(f"curve     tensorboard --logdir {out / 'tensorboard'}")


@click.command()
@_lessons(drives=290, out="runs/frames")
def frames(workers: int | None, cache_gb: float, out: Path, **lessons: Any) -> None:
    """What plant2-ft is shown: counts, targets, and ten frames of each group as pictures."""
    from tsbench.learn.finetune_recipe import lessons_of
    from tsbench.learn.finetune_report import report

    recipe, rows = _recipe(**lessons)
    workers = workers or len(os.sched_getaffinity(0))
    for path in report(lessons_of(rows, recipe), recipe, out, workers, int(cache_gb * 1e9), click.echo):
        click.echo(path)


def _recipe(types: str, trajectories: Path | None, **options: Any) -> tuple[FineTuning, list[ScenarioSpec]]:
    from tsbench.learn.finetune_recipe import FineTuning
    from tsbench.learn.trajectories import trajectories_path
    from tsbench.run.plan import choose_types
    from tsbench.scenarios.table import read_table, table_path
    from tsbench.signs.catalog import load_catalog

    words = tuple(word.strip() for word in types.split(",") if word.strip())
    rows = read_table(table_path("train"))
    if words:
        chosen = choose_types(words, load_catalog())
        rows = [row for row in rows if row.scenario_type in chosen]
    path = trajectories or trajectories_path()
    return FineTuning(trajectories=path, types=words, **options), rows
