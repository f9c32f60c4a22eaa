"""`tsbench train plant2`."""

from __future__ import annotations

import os
from pathlib import Path

import click

from tsbench.planners.batched import DEVICES


@click.command()
@click.option("--size", type=click.Choice(("mini", "medium")), default="mini", show_default=True)
@click.option(
    "--episodes", default=4000, show_default=True, type=click.IntRange(min=1), help="Drives to learn from."
)
@click.option(
    "--epochs", default=12, show_default=True, type=click.IntRange(min=1), help="Passes over their frames."
)
@click.option(
    "--driver", "drivers", multiple=True, default=("idm",), show_default=True, metavar="PLANNER",
    help="Who is imitated; several take turns.",
)  # fmt: skip
@click.option("--types", default="", metavar="TYPE,GROUP,…", help="Default: all.")
@click.option("--batch", default=256, show_default=True, type=click.IntRange(min=1))
@click.option("--rate", default=6e-4, show_default=True, type=click.FloatRange(min=0.0, min_open=True))
@click.option(
    "--validation", default=160, show_default=True, type=click.IntRange(min=1),
    help="Episodes driven after each epoch; the best network is kept.",
)  # fmt: skip
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0))
@click.option("--device", type=click.Choice(DEVICES), default="cpu", show_default=True)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes that drive, threads that learn; default: one per core.",
)
@click.option(
    "--cache-gb",
    default=8.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    help="Bound of frames on disk.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default="runs/train-plant2", show_default=True, metavar="DIR",
    help="Folder of the training; what it holds of it already is continued.",
)  # fmt: skip
def plant2(
    size: str, episodes: int, epochs: int, drivers: tuple[str, ...], types: str, batch: int, rate: float,
    validation: int, seed: int, device: str, workers: int | None, cache_gb: float, out: Path,
) -> None:  # fmt: skip
    """Imitation of sign-blind driving; writes plant2.safetensors and plant2.json."""
    from tsbench.learn.imitation import Imitation  # brings torch
    from tsbench.learn.imitation_recipe import Recipe
    from tsbench.learn.trainer import Place, train
    from tsbench.run.plan import choose_types
    from tsbench.scenarios.table import read_table, table_path
    from tsbench.signs.catalog import load_catalog

    words = tuple(word.strip() for word in types.split(",") if word.strip())
    rows = read_table(table_path("train"))
    if words:
        chosen = choose_types(words, load_catalog())
        rows = [row for row in rows if row.scenario_type in chosen]
    recipe = Recipe(
        size=size, episodes=episodes, epochs=epochs, drivers=drivers, types=words, batch=batch, rate=rate,
        validation=validation, seed=seed,
    )  # fmt: skip
    place = Place(out, device, workers or len(os.sched_getaffinity(0)), int(cache_gb * 1e9))
    made = train(Imitation(recipe, rows), place, click.echo)
    weights = f"{made.weights.size / 1e6:.1f} MB, {made.parameters:,} parameters"
    click.echo(f"weights   {out / made.weights.file} ({weights})")
    click.echo(f"curve     tensorboard --logdir {out / 'tensorboard'}")
