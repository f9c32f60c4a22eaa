"""`tsbench debug`: one episode in this process, with what the planner sees, prints and raises."""

from __future__ import annotations

import math
import pdb
import sys
import traceback
from bdb import BdbQuit
from pathlib import Path

import click

from tsbench.api.drive import Drive, row_of
from tsbench.cli import EXIT_FAILED, options
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.perception_level import EXACTLY, Perception, load_level
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.run.log.manifest import planners_of
from tsbench.run.log.read import read_run
from tsbench.scenarios.data_set import DataSet


@click.command()
@click.argument("run", type=options.PATH, required=False)
@click.argument("episode", required=False)
@click.option(
    "--planner",
    type=options.TEXT,
    metavar=options.PLANNER,
    help="Without a run: who drives.",
    shell_complete=options.registered_names,
)
@click.option("--scenario", metavar="ID", help="Without a run: what is driven.", shell_complete=options.scenario_ids)
@options.split()
@click.option("--mask-signs", is_flag=True, help="Remove sign identity from what the planner sees.")
@options.perception("How well it perceives plates.")
@click.option("--at", type=float, metavar="S", help="Stop at this time.  [default: the end]")
@options.png("Draw the moment at which it stops.")
@click.option("--pdb", "debugger", is_flag=True, help="Python's debugger: at --at, and where the planner raises.")
def debug(
    run: Path | None, episode: str | None, planner: str | None, scenario: str | None, data: DataSet, split: str | None,
    mask_signs: bool, perception: str, at: float | None, png: Path | None, debugger: bool,
) -> None:  # fmt: skip
    """Drive one episode in this process: EPISODE (scenario_id or planner/scenario_id) of the run folder RUN, or a
    scenario with a planner.

    `breakpoint()` and `print` in the planner work. Where it stops, what the planner is shown, answered and is held
    against it is printed. Exit code 1 where the planner raises.
    """
    perceived = Perception(mask_signs, load_level(perception))
    if run is not None and episode is not None:
        if planner or scenario or split or perceived != EXACTLY:
            raise InputError("a run has its planner, plates and perception: name RUN and EPISODE alone")
        stored = read_run(run)
        name, _, scenario = episode.rpartition("/")
        found = [info.spec for info in planners_of(stored.manifest) if name in ("", info.name)]
        if len(found) != 1:
            names = ", ".join(f"{info.name}/{scenario}" for info in planners_of(stored.manifest))
            raise InputError(f"{run}: {episode}: name one of {names}")
        planner, split = found[0], str(stored.manifest["effective"]["split"])
        perceived, data = stored.perception, stored.data
    elif run is not None or planner is None or scenario is None:
        raise InputError("name what to drive: RUN EPISODE, or --planner and --scenario")
    row = row_of(data, scenario, split)
    try:
        # What a run drove in an image is driven here as it stands in its file.
        _follow(Drive(PlannerSpec.parse(planner).text, row, data, perceived), at, png, debugger)
    except BdbQuit:
        return
    except InputError:
        raise
    except Exception as problem:
        traceback.print_exc()
        if debugger:
            pdb.post_mortem(problem.__traceback__)
        sys.exit(EXIT_FAILED)


def _follow(drive: Drive, at: float | None, png: Path | None, debugger: bool) -> None:
    """Drive, and tell how it stands."""
    try:
        drive.run(math.inf if at is None else at)
    finally:
        click.echo(drive.look())
        if png is not None:
            with io_errors_as_input_errors(png):
                write_atomic(png, drive.frame)
            click.echo(str(png))
    console = _Debugger()
    while debugger and drive.observation is not None:
        # Stops at the first line of `act`; `c` goes on to the next tick.
        answer = console.runcall(drive.planner.act, drive.observation)
        if console.left:
            return
        drive.step(answer)


class _Debugger(pdb.Pdb):
    """left: the user has quit."""

    left = False

    def set_quit(self) -> None:
        self.left = True
        super().set_quit()
