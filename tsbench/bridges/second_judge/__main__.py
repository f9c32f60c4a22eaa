"""`python -m tsbench.bridges.second_judge RUN`: agreement of both judges over a run, into RUN/second_judge."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from tsbench.core.errors import InputError
from tsbench.core.paths import expanded
from tsbench.core.text import csv_text


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for its files; default: RUN/second_judge.")
def main(run: Path, out: Path | None) -> None:
    """Let CommonRoad's monitor judge the speed and stop episodes of RUN (made with --trace all), and compare."""
    run = expanded(run)
    folder = run / "second_judge" if out is None else expanded(out)
    try:
        from tsbench.bridges.second_judge.comparison import cases, reasons, rows, table  # needs its packages

        found = list(cases(run, folder / "episodes", _tell))
    except InputError as problem:
        click.echo(f"error: {problem}", err=True)
        sys.exit(2)
    text = f"{table(found)}\n{reasons(found)}"
    (folder / "agreement.md").write_text(text, encoding="utf-8")
    told = rows(found)
    cells = csv_text([list(told[0]), *(list(row.values()) for row in told)])
    (folder / "agreement.csv").write_text(cells, encoding="utf-8")
    click.echo(text)


def _tell(done: int, of: int) -> None:
    click.echo(f"\r{done} of {of} episodes", nl=False, err=True)


if __name__ == "__main__":
    main()
