"""`tsbench doctor`."""

from __future__ import annotations

import click

from tsbench.cli import EXIT_FAILED
from tsbench.cli.diagnosis import Status, examine

_COLOURS = {"ok": "green", "note": "yellow", "failed": "red"}


@click.command()
@click.option(
    "--arithmetic", is_flag=True, help="Whether each planner gives the reference bytes here, and nothing else."
)
@click.option(
    "--write", is_flag=True, help="With --arithmetic: make what comes out here the reference, for review by `git diff`."
)
def doctor(arithmetic: bool, write: bool) -> None:
    """Check this installation, its data and this machine; exit code 1 if something keeps tsbench from working.

    A note is about what only some commands need.
    """
    findings = examine()
    if write and not arithmetic:
        raise click.UsageError("--write goes with --arithmetic")
    if arithmetic:
        from tsbench.cli.network_arithmetic import check_arithmetic, write_reference

        if write:
            for path in write_reference():
                click.echo(f"written: {path}")
        findings = check_arithmetic()
    failed = 0
    for finding in findings:
        failed += finding.status is Status.FAILED
        word = click.style(f"{finding.status:<7}", fg=_COLOURS[finding.status])
        click.echo(f"{word} {finding.name:<9} {finding.text}")
        if finding.remedy:
            click.echo(f"{'':<17} -> {finding.remedy}")
    click.echo("nothing is in the way" if not failed else f"failed: {failed}")
    if failed:
        raise SystemExit(EXIT_FAILED)
