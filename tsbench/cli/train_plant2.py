"""`tsbench train plant2`."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli import train_options as share
from tsbench.cli.options import several, words_of
from tsbench.core.machine import own_cores


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
@click.option("--batch", default=256, show_default=True, type=click.IntRange(min=1))
@click.option("--rate", default=6e-4, show_default=True, type=click.FloatRange(min=0.0, min_open=True))
@click.option(
    "--validation", default=160, show_default=True, type=click.IntRange(min=1),
    help="Episodes driven after each epoch; the best network is kept.",
)  # fmt: skip
@several(share.types, share.seed, share.device, share.workers, share.cache_gb, share.out("runs/train-plant2"))
def plant2(
    size: str, episodes: int, epochs: int, drivers: tuple[str, ...], types: str, batch: int, rate: float,
    validation: int, seed: int, device: str, workers: int | None, cache_gb: float, out: Path,
) -> None:  # fmt: skip
    """Imitation of sign-blind driving; writes plant2.safetensors and plant2.json."""
    from tsbench.learn.imitation.recipe import Recipe
    from tsbench.learn.imitation.task import Imitation  # brings torch
    from tsbench.learn.imitation.trainer import Place, train

    words = words_of(types)
    recipe = Recipe(
        size=size, episodes=episodes, epochs=epochs, drivers=drivers, types=words, batch=batch, rate=rate,
        validation=validation, seed=seed,
    )  # fmt: skip
    place = Place(out, device, workers or own_cores(), int(cache_gb * 1e9))
    share.tell(out, train(Imitation(recipe, share.train_rows(words)), place, click.echo))
