"""`tsbench submit`, `verify` and `leaderboard`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any
from urllib.parse import quote

import click
from rich.progress import Progress

from tsbench.board.claim import claim_of, claims_of, make_submission
from tsbench.board.submission import json_schema
from tsbench.board.verification import ClaimVerdict, Verification
from tsbench.board.verification import verify as run_verify
from tsbench.cli import EXIT_FAILED, EXIT_NOT_COMPARABLE, options
from tsbench.core.errors import InputError, load
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.streams import progress_console
from tsbench.planners.planner_spec import PlannerSpec

_SEED, _DRAWN = click.IntRange(0, 2**63 - 1), "Of the draw: your own choice, made after the submission."


@click.command()
@click.argument("folder", metavar="RUN", type=options.PATH)
@click.option("--planner", metavar="NAME", help="Which planner's, where the run has several.")
@click.option("--title", default="", metavar="TEXT", help="The row's name.  [default: the planner's]")
@click.option("--authors", required=True, metavar="TEXT", help="Who submits.")
@click.option("--url", default="", metavar="URL", help="Where code and weights are.")
@click.option("--note", default="", metavar="TEXT", help="What a reader of the row has to know.")
@click.option("--third-party", is_flag=True, help="The planner is of other people than tsbench's.")
@click.option("--shared-process", is_flag=True, help="Take a run without --isolate; the row is then marked so.")
@options.count(
    "--copy-traces",
    "traces",
    least=0,
    default=0,
    help="Failures whose traces are copied beside the file, for the site to play.",
)
@options.out("JSON file to write.  [default: <planner>-<split>[-<level>].json]", type=options.FILE)
def submit(folder: Path, planner: str | None, traces: int, out: Path | None, **told: Any) -> None:
    """Check a RUN of a whole split and write its submission: figures, hashes, and a digest of each episode.

    The run is judged again from its traces. docs/leaderboard.md says where the file goes.
    """
    made = make_submission(folder, planner, **told)
    level = "" if made.perception is None else f"-{quote(made.level, safe='')}"
    path = out or Path(f"{made.planner.name}-{made.split}{level}.json")
    with io_errors_as_input_errors(path):
        write_atomic(path, made.to_json().encode())
    click.echo(
        f"{path}: {made.title}, {len(made.episodes)} episodes of {made.edition} ({made.split}), "
        f"{made.rescored} judged again from their traces"
    )
    if traces:
        players = load("tsbench.board.players")
        count = players.copy_traces(folder, made, path, traces)
        click.echo(f"{players.traces_beside(path)}: {count} traces")


@click.command()
@click.argument("claimed", metavar="SUBMISSION|RUN", type=options.PATH)
@click.option(
    "--planner",
    type=options.TEXT,
    metavar="SPEC",
    help="What to drive, as for tsbench run.  [default: as the claim says]",
)
@options.image
@click.option("--of", "name", metavar="NAME", help="Of a run: this planner's episodes only.  [default: of each]")
@options.count("--sample", default=100, help="Episodes to drive, of each planner.")
@click.option("--seed", type=_SEED, required=True, metavar="N", help=_DRAWN)
@click.option(
    "--shared-process",
    is_flag=True,
    help="Drive it beside the referee: for a planner whose code you trust. The record says so.",
)
@click.option("--by", "verifier", default="", metavar="TEXT", help="Who verifies.")
@options.run_workers
@options.out("JSON file to write the record to.", type=options.FILE)
def verify(
    claimed: Path, planner: str | None, image: str | None, name: str | None, out: Path | None, **asked: Any
) -> None:
    """Drive a sample of a SUBMISSION's or a RUN's episodes again and compare.

    Exit status 1 where it is refuted, 3 where the verdicts are equal and the bytes cannot be compared.
    """
    claims = claims_of(claimed) if claimed.is_dir() else [claim_of(claimed)]
    if name is not None:
        names = ", ".join(claim.planner.name for claim in claims)
        claims = [claim for claim in claims if claim.planner.name == name]
        if not claims:
            raise InputError(f"{claimed}: no planner {name}; there are {names}")
    if len(claims) > 1 and (planner, out) != (None, None):
        raise InputError(f"{claimed}: several planners: with --planner or --out, name one by --of")
    console, verdicts = progress_console(), set()
    for claim in claims:
        driven = planner
        if image is not None:
            own = PlannerSpec(PlannerSpec.parse(claim.planner.spec).text)
            driven = str((PlannerSpec.parse(planner) if planner else own).in_image(image))
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(f"driving {claim.title} again", total=None)
            found = run_verify(
                claim,
                driven,
                on_progress=lambda done, of, bar=bar, task=task: bar.update(task, completed=done, total=of),  # type: ignore[misc]
                **asked,
            )
        if out is not None:
            with io_errors_as_input_errors(out):
                write_atomic(out, found.to_json().encode())
        _say(found)
        verdicts.add(found.verdict)
    if ClaimVerdict.REFUTED in verdicts:
        sys.exit(EXIT_FAILED)
    if ClaimVerdict.VERDICTS_ONLY in verdicts:
        sys.exit(EXIT_NOT_COMPARABLE)


def _say(found: Verification) -> None:
    click.echo(f"{found.title}: {found.equal} of {len(found.driven)} episodes as submitted, byte for byte")
    if found.explained:
        click.echo(
            f"{len(found.explained)} have the same verdict and other bytes: {'; '.join(found.arithmetic_differences)}"
        )
    for difference in found.differences:
        click.echo(" ".join(filter(None, (difference.scenario_id, difference.what))))
    if not found.isolated:
        click.echo("driven beside the referee: what a planner changes of it in its own favour is not found so")
    click.echo(found.verdict)


@click.group()
def leaderboard() -> None:
    """The leaderboard: a static site of submissions and the records of their verifications."""


@leaderboard.command()
@click.argument("folder", metavar="DIR", type=options.FOLDER)
@options.out("Folder of the site.", default="build/leaderboard", type=options.FOLDER)
@options.count(
    "--players", least=0, default=12, help="Failures to watch, of each submission that has traces beside it."
)
def build(folder: Path, out: Path, players: int) -> None:
    """Render the site from the JSON files below DIR; they may lie in any folders there.

    Traces of NAME.json lie in NAME.traces beside it.
    """
    pages = load("tsbench.board.site").build_site(folder, out, players)
    click.echo(f"{out / 'index.html'}: {pages} rows")


@leaderboard.command()
def schema() -> None:
    """Print the JSON Schema of submissions."""
    click.echo(json.dumps(json_schema(), indent=1))
