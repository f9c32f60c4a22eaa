"""`tsbench compare`."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.cli.console import table_console


@click.command()
@click.argument("run_a", metavar="RUN_A[:PLANNER]")
@click.argument("run_b", metavar="RUN_B[:PLANNER]")
@click.option("--force", is_flag=True, help="Compare different contracts, or what different scenarios share.")
@click.option("--allow-partial", is_flag=True, help="Compare runs with missing records; the title says so.")
@click.option(
    "--png", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Draw the differences."
)
@click.option(
    "--csv", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write all flips."
)
@click.option(
    "--flips", type=click.IntRange(min=0), default=20, show_default=True, metavar="N",
    help="Flipped scenarios to list, of the lost and of the won each.",
)  # fmt: skip
def compare(
    run_a: str, run_b: str, force: bool, allow_partial: bool, png: Path | None, csv: Path | None, flips: int
) -> None:
    """Compare two planners scenario by scenario: what changed by type and group, and what flipped.

    A run with several planners is given as RUN:PLANNER. B-A is shown: more is better for B. Runs of different contracts
    or scenarios are refused unless forced.
    """
    from tsbench.report.tables.compare import compare_runs
    from tsbench.report.tables.compare_table import flips_csv, print_comparison

    matched = compare_runs(run_a, run_b, force=force, allow_partial=allow_partial)
    print_comparison(matched, table_console(), flips)
    if csv is not None:
        flips_csv(matched.comparison, csv)
        click.echo(f"flips     {csv}")
    if png is not None:
        from tsbench.report.tables.forest import draw_forest  # brings matplotlib

        draw_forest(matched, png)
        click.echo(f"picture   {png}")
