"""`tsbench planners`: who there is, and what is wrong with one of your own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tsbench.cli.console import print_table
from tsbench.planners import registry

if TYPE_CHECKING:
    from tsbench.planners.check import Finding


@click.group()
def planners() -> None:
    """List planners, check one of your own."""


@planners.command("list")
@click.option(
    "--parts", is_flag=True, help="Print instead how the parameters of plant2 and plant2-ft are made up."
)
def list_planners(parts: bool) -> None:
    """Print the registered planners."""
    if parts:
        _print_parts()
        return
    rows = []
    for name in registry.names():
        entry = registry.entry(name)
        weights = entry.weights
        rows.append((
            name, entry.kind, "yes" if entry.sign_access else "no", "yes" if entry.privileged else "no",
            f"{entry.parameters:,}" if entry.parameters is not None else "-",
            f"{weights.size / 1e6:.1f} MB {weights.sha256[:12]} {weights.source}" if weights else "-",
        ))  # fmt: skip
    print_table(("name", "kind", "sees signs", "knows the rule", "parameters", "weights"), rows, left=6)
    click.echo(
        "Others: pkg.module:Class, file.py:Class, or a function in place of the class; with -e: its expert."
    )


def _print_parts() -> None:
    from tsbench.planners.plant2.parts import parts  # brings torch

    rows = [
        (large.name, f"{small.parameters:,}", f"{large.parameters:,}", large.published or "-")
        for small, large in zip(parts("mini"), parts("medium"), strict=True)
    ]
    print_table(("part", "mini", "medium", "published (medium)"), rows)


@planners.command("check")
@click.argument("planner")
@click.option(
    "--limit",
    default=10,
    show_default=True,
    type=click.IntRange(2, 100),
    metavar="N",
    help="Scenes to drive.",
)
@click.option(
    "--submission",
    is_flag=True,
    help="Drive it isolated, on dev scenes, and say what `tsbench submit` would refuse.",
)
def check(planner: str, limit: int, submission: bool) -> int:
    """Drive PLANNER through a few scenes and say what is wrong with it; exit code 1 if anything is."""
    if submission:
        return _check_submission(planner, limit)
    # Not before it is needed: these bring SUMO with them.
    from tsbench.planners.check import Level, check_statically
    from tsbench.scenarios.table import read_table, table_path
    from tsbench.tools.check import check_driving, choose

    loaded = registry.resolve(planner)
    chosen = choose(read_table(table_path("test")), limit)
    console = Console()
    found = check_statically(loaded)
    if all(f.level is not Level.PROBLEM for f in found):
        with console.status(f"driving {len(chosen)} scenes"):
            found += check_driving(planner, chosen)
    return _tell(planner, found, console)


def _check_submission(planner: str, limit: int) -> int:
    from tsbench.tools.check_submission import check_submission  # brings SUMO

    console = Console()
    with console.status("") as status:
        found = check_submission(planner, limit, "test", status.update)
    return _tell(planner, found, console)


def _tell(planner: str, found: list[Finding], console: Console) -> int:
    from tsbench.planners.check import Level

    style = {Level.OK: "green", Level.NOTE: "yellow", Level.PROBLEM: "bold red"}
    table = Table(box=None, show_header=False)
    for finding in found:
        table.add_row(f"[{style[finding.level]}]{finding.level}[/]", finding.topic, escape(finding.text))
    console.print(table)
    problems = sum(f.level is Level.PROBLEM for f in found)
    console.print(f"{planner}: {'no problems' if not problems else f'{problems} problem(s)'}")
    return 1 if problems else 0
