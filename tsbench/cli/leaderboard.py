"""`tsbench submit`, `verify` and `leaderboard`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
from rich.console import Console
from rich.progress import Progress

from tsbench.cli import EXIT_FAILED, options
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.paths import using_city


@click.command()
@click.argument("folder", metavar="RUN", type=options.PATH, callback=options.of_their_city)
@click.option("--planner", metavar="NAME", help="Which planner's, where the run has several.")
@click.option("--title", default="", metavar="TEXT", help="The row's name.  [default: the planner's]")
@click.option("--authors", required=True, metavar="TEXT", help="Who submits.")
@click.option("--url", default="", metavar="URL", help="Where code and weights are.")
@click.option("--note", default="", metavar="TEXT", help="What a reader of the row has to know.")
@click.option("--third-party", is_flag=True, help="The planner is of other people than tsbench's.")
@options.out("JSON file to write.  [default: <planner>-<split>.json]", type=options.FILE)
def submit(
    folder: Path, planner: str | None, title: str, authors: str, url: str, note: str, third_party: bool,
    out: Path | None,
) -> None:  # fmt: skip
    """Check a RUN of a whole split and write its submission: figures, hashes, and a digest of each episode.

    The run is judged again from its traces. docs/leaderboard.md says where the file goes.
    """
    from tsbench.leaderboard.submit import make_submission

    made = make_submission(
        folder, planner, title=title, authors=authors, url=url, note=note, third_party=third_party
    )
    path = out or Path(f"{made.planner.name}-{made.split}.json")
    with io_errors_as_input_errors(path):
        write_atomic(path, made.to_json().encode())
    click.echo(
        f"{path}: {made.title}, {len(made.episodes)} episodes of {made.edition} ({made.split}), "
        f"{made.rescored} judged again from their traces"
    )


@click.command()
@click.argument("submission", type=options.FILE)
@click.option("--planner", metavar="SPEC", help="What to drive, as for tsbench run.  [default: as submitted]")
@click.option(
    "--sample", type=options.POSITIVE, default=100, show_default=True, metavar="N", help="Episodes to drive."
)
@click.option(
    "--seed", type=click.IntRange(min=0), required=True, metavar="N",
    help="Of the draw: your own choice, made after the submission.",
)  # fmt: skip
@click.option("--by", "verifier", default="", metavar="TEXT", help="Who verifies.")
@options.run_workers
@options.out("JSON file to write the record to.", type=options.FILE)
def verify(
    submission: Path, planner: str | None, sample: int, seed: int, verifier: str, workers: int | None, out: Path | None
) -> None:  # fmt: skip
    """Drive a sample of a SUBMISSION's episodes again and compare; exit status 1 where it is refuted."""
    from tsbench.leaderboard.submission import read_submission
    from tsbench.leaderboard.verify import verify as run_verify

    console = Console(stderr=True)
    with using_city(read_submission(submission).city), Progress(console=console, transient=True) as bar:
        task = bar.add_task("driving again", total=None)
        found = run_verify(
            submission, planner, sample=sample, seed=seed, verifier=verifier, workers=workers,
            told=lambda done, of: bar.update(task, completed=done, total=of),
        )  # fmt: skip
    if out is not None:
        with io_errors_as_input_errors(out):
            write_atomic(out, found.to_json().encode())
    click.echo(f"{found.title}: {found.equal} of {len(found.driven)} episodes as submitted, byte for byte")
    if found.explained:
        click.echo(
            f"{len(found.explained)} have the same verdict and other bytes: {found.arithmetic_difference}"
        )
    for difference in found.differences:
        click.echo(" ".join(filter(None, (difference.scenario_id, difference.what))))
    click.echo("confirmed" if found.confirmed else "refuted")
    if not found.confirmed:
        sys.exit(EXIT_FAILED)


@click.group()
def leaderboard() -> None:
    """The leaderboard: a static site of submissions and the records of their verifications."""


@leaderboard.command()
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@options.out("Folder of the site.", default="build/leaderboard", type=options.FOLDER)
def build(folder: Path, out: Path) -> None:
    """Render the site from the JSON files below DIR; they may lie in any folders there."""
    from tsbench.core.extras import load

    pages = load("tsbench.leaderboard.site").build_site(folder, out)
    click.echo(f"{out / 'index.html'}: {pages} rows")


@leaderboard.command()
def schema() -> None:
    """Print the JSON Schema of submissions."""
    from tsbench.leaderboard.submission import json_schema

    click.echo(json.dumps(json_schema(), indent=1))
