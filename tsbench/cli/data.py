"""`tsbench data`: list, fetch."""

from __future__ import annotations

import click

from tsbench.cli import options
from tsbench.cli.console import print_table
from tsbench.core.fetch import DataFile, DataPart, data_set, data_sets, fetch_set
from tsbench.core.paths import data_file, fetch_root


@click.group()
def data() -> None:
    """The data that tsbench knows, and where it is; fetch what is missing."""


@data.command("list")
@click.argument("names", nargs=-1, metavar="[NAME]…")
def list_(names: tuple[str, ...]) -> None:
    """Print the sets of data; with NAMEs, every file of these sets: SHA-256, size in bytes, name, place."""
    if names:
        for file in (file for name in names for file in data_set(name).files):
            click.echo(f"{file.sha256} {file.size:>11,} {file.name}  {_place(file) or 'missing'}")
        return
    rows = []
    for found in data_sets().values():
        gone = sum(_place(file) is None for file in found.files)
        size = f"{found.size / 1e6:.1f}"
        rows.append((found.name, str(len(found.files)), size, str(gone or "none"), found.about))
    print_table(("name", "files", "MB", "missing", "what"), rows, left=5)
    click.echo(f"What is missing: tsbench data fetch --from DIR|URL NAME; it goes to {fetch_root()}")


@data.command()
@click.option(
    "--from",
    "source",
    type=options.TEXT,
    required=True,
    metavar="DIR|URL",
    help="Folder, or http(s) address, with the files.",
)
@click.argument("names", nargs=-1, metavar="[NAME]…")
def fetch(source: str, names: tuple[str, ...]) -> None:
    """Bring the sets NAME (default: all) from a folder or an address; a file counts only with its SHA-256.

    Complete files are skipped: the same command goes on where it was broken off.
    """

    def tell(file: DataFile) -> None:
        click.echo(f"{file.name}  {file.size / 1e6:.1f} MB")

    wanted: list[DataPart] = [data_set(name) for name in names] or list(data_sets().values())
    for found in wanted:
        came = fetch_set(found, source, tell)
        click.echo(f"{found.name}: {came} of {len(found.files)} files fetched, all there")


def _place(file: DataFile) -> str | None:
    """Where a file is, None where it is missing or of another size."""
    place = data_file(file.name)
    return str(place) if place.is_file() and place.stat().st_size == file.size else None
