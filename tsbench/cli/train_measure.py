"""`tsbench train measure`: what weights can do, on the maps that no training learns from."""

from __future__ import annotations

from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.table import Table

from tsbench.cli import train_options as share
from tsbench.cli.console import table_console
from tsbench.cli.options import words_of
from tsbench.core.errors import InputError
from tsbench.core.machine import own_cores

# Of `Skill`, with heads that leave 80 columns for the types' names.
_SHARES = {
    "arrived": "ar-\nrived", "collision": "col-\nlision", "off_road": "off\nroad", "timeout": "time-\nout",
    "compliant": "com-\nplied", "scd": "SCD",
}  # fmt: skip


@click.command()
@click.argument("folder", type=share.FOLDER, required=False)
@click.option("--planner", type=click.Choice(["plant2", "plant2-ft"]), default="plant2-ft", show_default=True)
@click.option("--each", default=4, show_default=True, type=click.IntRange(min=1), help="Episodes of a type.")
@click.option(
    "--stop-policy", type=(float,) * 5, metavar="SHARE WAITS RISE SETTLES BRAKES",
    help="Of plant2-ft, instead of its own: from which share of standing it halts, what is added to that "
    "each second (1/s) after a wait of so many seconds, how many seconds a halt lasts beyond the last such plan, and "
    "its least deceleration (m/s2).",
)  # fmt: skip
@share.types
@share.seed
@share.workers
def measure(
    folder: Path | None, planner: str, each: int, stop_policy: tuple[float, ...] | None, types: str,
    seed: int, workers: int | None,
) -> None:  # fmt: skip
    """How the weights in FOLDER (default: tsbench's own) drive on kept-out maps of the train split, by type."""
    from tsbench.learn.imitation.recipe import validation_rows
    from tsbench.learn.imitation.skill import drive, skill_of
    from tsbench.metrics.intervals import wilson
    from tsbench.planners.plant2.planner_ft import StopPolicy
    from tsbench.planners.weights import network

    network(planner, folder)
    if stop_policy and planner != "plant2-ft":
        raise InputError(f"--stop-policy: {planner} has none")
    rows = share.train_rows(words_of(types))
    rows = validation_rows(rows, each * len({row.scenario_type for row in rows}), seed)
    ends = drive(
        planner, folder, rows, workers or own_cores(), StopPolicy(*stop_policy) if stop_policy else None
    )
    table = Table(
        "type", "n", *_SHARES.values(), box=SIMPLE_HEAD, title="shares of episodes, %", title_justify="left"
    )
    kinds = [row.scenario_type for row in rows]
    skills = {
        kind: skill_of([end for k, end in zip(kinds, ends, strict=True) if k == kind])
        for kind in sorted(set(kinds))
    }
    skills["all"] = whole = skill_of(ends)
    for name, skill in skills.items():
        shares = (f"{100.0 * getattr(skill, share):.1f}" for share in _SHARES)
        table.add_row(name, str(skill.episodes), *shares)
    table_console().print(table)
    low, high = wilson(round(whole.scd * whole.episodes), whole.episodes)
    click.echo(
        f"SCD {100.0 * whole.scd:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f}, 95 % interval of Wilson)"
    )
