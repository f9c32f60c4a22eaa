"""`tsbench planners`: who there is, and what is wrong with one of your own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tsbench.cli import options
from tsbench.cli.console import print_table
from tsbench.core.errors import InputError, load
from tsbench.episode.outcome import Outcome
from tsbench.planners import registry
from tsbench.planners.check import Level, check_statically
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from tsbench.planners.check import Finding


@click.group()
def planners() -> None:
    """List planners, check one of your own."""


@planners.command("list")
@click.option("--parts", is_flag=True, help="Print instead how the parameters of plant2 and plant2-ft are made up.")
def list_planners(parts: bool) -> None:
    """Print the registered planners."""
    if parts:
        _print_parts()
        return
    rows = []
    for name in registry.names():
        entry = registry.entry(name)
        weights = entry.weights
        signs, privileged = "yes" if entry.sign_access else "no", "yes" if entry.privileged else "no"
        parameters = f"{entry.parameters:,}" if entry.parameters is not None else "-"
        source = f"{weights.size / 1e6:.1f} MB {weights.sha256[:12]} {weights.source}" if weights else "-"
        rows.append((name, entry.kind, signs, privileged, parameters, source))
    print_table(("name", "kind", "sees signs", "knows the rule", "parameters", "weights"), rows, left=6)
    click.echo(
        "Others: pkg.module:Class, file.py:Class, or a function in place of the class; nuplan: before it: a planner "
        "of nuPlan's; with -e: its expert."
    )


def _print_parts() -> None:
    from tsbench.learn.plant2.plant2_network import parts  # brings torch

    rows = [
        (name, f"{small:,}", f"{large:,}", published or "-")
        for (_, small, _), (name, large, published) in zip(parts("mini"), parts("medium"), strict=True)
    ]
    print_table(("part", "mini", "medium", "published (medium)"), rows)


@planners.command("check")
@click.argument("planner", type=options.TEXT, shell_complete=options.registered_names)
@options.count("--limit", default=10, least=2, most=100, help="Scenes to drive.")
@click.option("--submission", is_flag=True, help="Drive it isolated, and say what `tsbench submit` would refuse.")
@options.image
@options.city
def check(planner: str, limit: int, submission: bool, image: str | None, data: DataSet) -> int:
    """Drive PLANNER through a few dev scenes and say what is wrong with it; exit code 1 if anything is."""
    if submission:
        return _check_submission(planner, limit, image)
    if image is not None:
        raise InputError(f"--image {image}: a planner runs in an image isolated only: add --submission")
    # Not before it is needed: these bring SUMO with them.
    from tsbench.run.check_planner import check_driving, choose

    loaded = registry.resolve(planner)
    # Somebody's own data set may have no dev split.
    there = data.splits
    split = "dev" if "dev" in there or not there else there[0]
    chosen = choose(data.table(split), limit)
    console = Console()
    found = check_statically(loaded)
    if all(f.level is not Level.PROBLEM for f in found):
        with console.status(f"driving {len(chosen)} {split} scenes"):
            found += check_driving(planner, chosen, data)
    return _tell(planner, found, console)


def _check_submission(planner: str, limit: int, image: str | None) -> int:
    from tsbench.board.check_submission import check_submission  # brings SUMO

    console = Console()
    with console.status("") as status:
        found = check_submission(str(PlannerSpec.parse(planner).in_image(image)), limit, "test", status.update)
    return _tell(planner, found, console)


def _tell(planner: str, found: list[Finding], console: Console) -> int:
    style = {Level.OK: "green", Level.NOTE: "yellow", Level.PROBLEM: "bold red"}
    table = Table(box=None, show_header=False)
    unreached = [f for f in found if f.topic in map(str, Outcome)]
    for finding in (f for f in found if f not in unreached):
        table.add_row(f"[{style[finding.level]}]{finding.level}[/]", finding.topic, escape(finding.text))
    console.print(table)
    for finding in unreached:
        console.print(f"{finding.topic}: {finding.text}", markup=False, highlight=False, soft_wrap=True)
    problems = sum(f.level is Level.PROBLEM for f in found)
    told = [f"{problems} problem(s)"] * bool(problems) + [f"{len(unreached)} scenes not reached"] * bool(unreached)
    console.print(f"{planner}: {', '.join(told) or 'no problems'}", markup=False)
    return 1 if problems else 0


@planners.command("from-sb3")
@click.argument("model", metavar="MODEL.zip", type=options.FILE)
@click.option("--draws", is_flag=True, help="Draw actions from the policy's density, as in training; else its mean.")
@click.option("--name", default="Policy", show_default=True, metavar="CLASS", help="Name of the planner.")
@options.out("Folder to write the planner to.  [default: MODEL]", type=options.FOLDER)
def from_sb3(model: Path, draws: bool, name: str, out: Path | None) -> None:
    """Make a planner of a policy of Stable-Baselines3 that was trained in tsbench's environment.

    It takes MLP policies of PPO, A2C, SAC, TD3 and DDPG. Nothing is unpickled.
    """
    folder = out or model.with_suffix("")
    made = load("tsbench.bridges.sb3.convert").convert(model, folder, draws=draws, name=name)
    facts = made.training
    stacked = f"{facts['frames']} frames of " if facts["frames"] > 1 else ""
    click.echo(
        f"{folder}: {facts['from']}, {made.parameters:,} parameters, sees {stacked}{facts['observation']}, acts by "
        f"{facts['action']}, a decision each {facts['hold']} ticks"
    )
    click.echo(f"tsbench run --planner {folder / 'planner.py'}:{name} --split dev")
