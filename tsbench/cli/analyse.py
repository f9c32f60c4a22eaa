"""`tsbench analyse`: the paper's tables and figures from stored runs."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli import options
from tsbench.cli.console import show_analysis
from tsbench.core.errors import load
from tsbench.report.analyses.pages import DECLARED, refresh
from tsbench.report.analyses.run_analyses import analyse_runs

_SEEN = "tsbench.learn.envs.seen_tables"
KINDS = {
    "main": "SCD (paired, signed, contrast) and conventional metrics of every planner, published figures below them.",
    "types": "SCD (paired, signed, contrast) of every planner on every type, and a heat map.",
    "intervals": "SCD overall and by group with intervals, beside the published figures.",
    "ablation": "What signs are worth: the same scenes with and without --mask-signs.",
    "perception": "SCD over perception levels, and what wrong perception did: runs with --perception.",
    "failures": "Each half: complied or not, arrived or not, what ended the rest, needless obedience.",
    "floor": "Every planner beside those that read no plate: SCD overall, by group and by type.",
    "squares": "Scenarios with two signs: squared SCD, rows passed, and which sign's rule is broken, by type.",
    "correlations": "Spearman's correlation of each conventional metric with SCD, over planners, by group.",
}


@click.group()
def analyse() -> None:
    """The paper's analyses of runs: a table each (CSV, LaTeX, Markdown) and, but for the main one, a figure (PNG, SVG).

    The runs of one command must have the same contract and the same selection of scenarios, and each planner may be in
    one of them only. See also: tsbench scenarios calibration, tsbench signs equivalents, tsbench signs sheet.
    """


def out(files: str) -> options.Option:
    return options.out(f"Folder for {files}.", "analyses", type=options.FOLDER)


def _command(name: str, line: str) -> None:
    @analyse.command(name, help=line, short_help=line)
    @options.runs
    @out("NAME.csv, NAME.tex, NAME.md and, where there is a figure, NAME.png and NAME.svg")
    @options.allow_partial
    def command(runs: tuple[Path, ...], out: Path, allow_partial: bool) -> None:
        show_analysis(analyse_runs(name, runs, allow_partial), out)


for _name, _line in KINDS.items():
    _command(_name, _line)


@analyse.command(short_help="Put tables and figures of analyses into Markdown pages that ask for them.")
@click.argument("pages", nargs=-1, required=True, metavar="PAGE…", type=options.PATH)
@click.option("--from", "folder", type=options.PATH, metavar="DIR", default=Path("analyses"), show_default=True)
def pages(pages: tuple[Path, ...], folder: Path) -> None:
    """Put tables and figures of analyses into Markdown pages, where comments ask for them.

    \b
    <!-- analysis main | columns planner, SCD all | contract -->
    <!-- end -->
    <!-- analysis types | bare -->            without intervals
    <!-- end -->
    <!-- analysis floor | where over = all --> some rows
    <!-- end -->
    <!-- analysis metrics -->                 the columns of an episode's metrics; `scene`: of an observation
    <!-- end -->
    <!-- figure types -->                     the picture of the next line
    """
    for page in pages:
        for path in refresh(page, folder, {**DECLARED, "scene": lambda: load(_SEEN).scene_columns()}):
            click.echo(str(path))
