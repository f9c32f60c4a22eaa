"""`tsbench seal`: secret, build, commit, check."""

from __future__ import annotations

from pathlib import Path

import click

from tsbench.board.seal import build_sealed, commitments, make_secret, problems, read_commitments, write_commitments
from tsbench.cli import options
from tsbench.cli.console import bars
from tsbench.core.errors import TsbenchError
from tsbench.make.city import sources_dir
from tsbench.run.edition import edition_now
from tsbench.scenarios.data_set import DataSet

_SECRET = "--secret"


@click.group()
def seal() -> None:
    """Scenes that nobody can prepare for, and the proof that they were not changed later (docs/holdout.md)."""


@seal.command()
@click.argument("file", type=options.FILE)
def secret(file: Path) -> None:
    """Make a secret. Who has it can make the scenes: keep it to yourself until they are published."""
    make_secret(file)
    click.echo(f"{file}: a secret of 256 bits")


@seal.command()
@options.city_name
@click.option(_SECRET, required=True, type=options.FILE, help="The file of the secret.")
@options.types
@options.osm
@options.workers
def build(data: DataSet, secret: Path, types: tuple[str, ...], osm_dir: Path | None, workers: int) -> None:
    """Build the city NAME's data set as `tsbench city build` does, drawn with a secret. Resumable."""
    chosen = options.types_of(data, types)
    with bars() as show:
        build_sealed(data, chosen, osm_dir or sources_dir(), secret, workers, show)
    click.echo(f"{edition_now(data)}: tsbench seal commit {data.name} --out FILE")


@seal.command()
@options.city_name
@options.out("The file to publish.", type=options.FILE, required=True)
def commit(data: DataSet, out: Path) -> None:
    """Write down the hashes of a sealed data set and of its secret: what is published before the scenes are."""
    found = commitments(data)
    write_commitments(found, out)
    rows = ", ".join(f"{split} {sum(counts.values()):,} rows" for split, counts in found.rows.items())
    click.echo(f"{out}: {found.edition}, {rows}, {len(found.files)} files")


@seal.command()
@click.argument("file", type=options.FILE)
@click.option(_SECRET, type=options.FILE, help="The secret, once it is published.")
def check(file: Path, secret: Path | None) -> None:
    """Are the scenes that are here those that were committed to? Exit code 1 where they are not."""
    published = read_commitments(file)
    found = problems(published, secret)
    for line in found:
        click.echo(line)
    if found:
        raise TsbenchError(f"{published.name}: {len(found)} differences from {file}")
    what = "" if secret is None else ", and the secret"
    click.echo(f"{published.edition}: all {len(published.files)} files are those of {file}{what}")
