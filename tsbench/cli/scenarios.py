"""`tsbench scenarios`: build, list, show, open, verify, stats, browse, calibration."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from tsbench.cli.console import table_console
from tsbench.cli.options import jurisdiction_option, words_of
from tsbench.core.errors import InputError
from tsbench.core.paths import data_root
from tsbench.dataset.maps.paths import sources_dir
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import SPLITS, read_table, table_path
from tsbench.signs.countries import Country

PROVER = "tsbench.dataset.certify.rejection_test:RejectionTest"


def _all_rows(split: str | None = None) -> list[ScenarioSpec]:
    """The rows of a split, which must be there; without one, of those that are: train need not be, nor both built."""
    if split is not None:
        return read_table(table_path(split))
    there = [path for name in SPLITS if (path := table_path(name)).is_file()]
    return [spec for path in there or [table_path(SPLITS[-1])] for spec in read_table(path)]


def _find(scenario_id: str) -> ScenarioSpec:
    for spec in _all_rows():
        if spec.scenario_id == scenario_id:
            return spec
    raise InputError(f"no scenario {scenario_id!r} (tsbench scenarios list names them)")


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    )


@click.group()
def scenarios() -> None:
    """Build and inspect the scenario tables and scene files."""


@scenarios.command()
@click.option("--types", default="", help="Comma-separated type ids; default: all that have a recipe.")
@click.option("--split", "splits", type=click.Choice(SPLITS), multiple=True, help="Default: both.")
@click.option("--osm", type=click.Path(path_type=Path), default=None, help="Folder of OSM extracts.")
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
def build(types: str, splits: tuple[str, ...], osm: Path | None, workers: int) -> None:
    """Fill each type's quotas from the pool: tables, scene files and certificates. Resumable."""
    from tsbench.dataset.scenes.build import BuildRequest, build_scenarios

    root = data_root() / "scenarios"
    request = BuildRequest(words_of(types), osm or sources_dir(), root, workers, PROVER, splits or SPLITS)
    with _progress() as bar:
        tasks: dict[str, TaskID] = {}

        def report(name: str, done: int, total: int) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(name, total=total)
            bar.update(tasks[name], completed=done)

        reports = build_scenarios(request, report)
    table = Table("type", "split", "maps", "quota missed", "maps passed over, by reason")
    for r in reports:
        reasons = "\n".join(f"{n} {why}" for why, n in r.reasons.items())
        table.add_row(r.type_id, r.split, str(sum(r.maps.values())), str(r.missed or "none"), reasons)
    Console().print(table)
    short = [f"{r.type_id} {r.split} lacks {r.short} maps" for r in reports if r.short]
    if short:
        raise InputError(f"the pool is too small: {', '.join(short)}")


@scenarios.command()
@click.option("--types", default="", help="Comma-separated type ids; default: all.")
@click.option("--split", type=click.Choice(SPLITS), default=None)
@click.option(
    "--sample", type=click.IntRange(1), metavar="N", help="N rows of each type, by lot; default: all."
)
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
def certify(types: str, split: str | None, sample: int | None, workers: int) -> None:
    """Drive rows once more in other processes and renew their certificates. Resumable; exit code 1 if any fails."""
    from tsbench.dataset.certify.recertify import draw_sample, recertify
    from tsbench.scenarios.store import check_files

    chosen = words_of(types)
    rows = [s for s in _all_rows(split) if not chosen or s.scenario_type in chosen]
    if sample is not None:
        rows = draw_sample(rows, sample)
    check_files(rows)
    with _progress() as bar:
        task = bar.add_task("certify", total=len(rows))
        failures = recertify(
            rows, data_root() / "scenarios", workers, lambda n: bar.update(task, completed=n)
        )
    for name, problem in failures:
        click.echo(f"{name}: {problem}")
    click.echo(f"{len(rows)} rows, {len(failures)} without a valid certificate")
    if failures:
        raise SystemExit(1)


@scenarios.command("list")
@click.option("--split", type=click.Choice(SPLITS), default=None)
@click.option("--type", "type_id", default=None, help="Only this scenario type.")
def list_(split: str | None, type_id: str | None) -> None:
    """One scenario id per line."""
    for spec in _all_rows(split):
        if type_id is None or spec.scenario_type == type_id:
            click.echo(spec.scenario_id)


@scenarios.command()
@click.argument("scenario_id")
@click.option("--png", type=click.Path(path_type=Path), default=None, help="Draw the scene to this file.")
@jurisdiction_option
def show(scenario_id: str, png: Path | None, country: Country | None) -> None:
    """A scenario as text, and as a picture."""
    from tsbench.report.description import scene_facts
    from tsbench.scenarios.scene_loader import load_scene

    spec = _find(scenario_id)
    scene = load_scene(spec)
    table = Table("field", "value", title=scenario_id)
    for key, value in asdict(spec).items():
        table.add_row(key, str(value))
    for key, value in scene_facts(scene, country).items():
        table.add_row(key, value)
    Console().print(table)
    if png is not None:
        from tsbench.report.video.render import render_scene_png

        render_scene_png(scene, png, scenario_id, country)
        click.echo(f"picture: {png}")


@scenarios.command("open")
@click.argument("scenario_id")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default=None, metavar="DIR",
    help="Folder for the scene's files.  [default: runs/scenes/ID]",
)  # fmt: skip
@click.option("--run", "launch", is_flag=True, help="Start sumo-gui too.")
def open_(scenario_id: str, out: Path | None, launch: bool) -> None:
    """Write a scene's files into a folder, and print the sumo-gui command that opens them."""
    import shlex
    import subprocess

    from tsbench.scenarios.scene_loader import load_scene

    scene = load_scene(_find(scenario_id))
    folder = out or Path("runs/scenes") / scenario_id
    files = {
        folder / file.path.name.removesuffix(".gz"): file.content for file in (scene.net, scene.additional)
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, content in files.items():
            path.write_bytes(content)
    except OSError as error:
        raise InputError(f"{folder}: the scene cannot be written here ({error.strerror})") from None
    net, additional = map(str, files)
    command = ["sumo-gui", "-n", net, "-a", additional, "--step-length", "0.1"]
    click.echo(f"scene: {net} and {additional}")
    click.echo(shlex.join(command))
    if launch:
        try:
            subprocess.run(command, check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise InputError(f"sumo-gui does not start here: {error}") from None


@scenarios.command()
@click.option("--split", type=click.Choice(SPLITS), default=None)
def verify(split: str | None) -> None:
    """Check hashes, files and scenes of all rows; exit code 1 and one line per problem."""
    from tsbench.dataset.scenes.verify import verify_certificates, verify_rows, verify_split
    from tsbench.scenarios.scene_loader import SceneLoader

    rows = _all_rows(split)
    with _progress() as bar:
        task = bar.add_task("verify", total=len(rows))
        problems = verify_rows(rows, SceneLoader(), lambda n: bar.update(task, completed=n))
    problems += verify_split(rows) + verify_certificates(rows, None)
    for name, problem in problems:
        click.echo(f"{name}: {problem}")
    click.echo(f"{len(rows)} rows, {len(problems)} problems")
    if problems:
        raise SystemExit(1)


@scenarios.command()
@click.option("--markdown", type=click.Path(path_type=Path), default=None, help="Write the tables there too.")
def stats(markdown: Path | None) -> None:
    """Rows, maps, unique places, certificates and quotas per type and split."""
    from tsbench.dataset.scenes.overview import build_report, type_stats
    from tsbench.report.tables.dataset import MAPS, ROWS, map_cells, row_cells, to_markdown

    figures, report = type_stats(_all_rows()), build_report()
    console = table_console()
    for heads, cells in ((ROWS, row_cells(figures)), (MAPS, map_cells(figures, report))):
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for head in heads:
            table.add_column(head, no_wrap=head in ("type", "split"))
        for row in cells:
            table.add_row(*row)
        console.print(table)
    if markdown is not None:
        markdown.write_text(to_markdown(figures, report), encoding="utf-8")
        click.echo(f"page: {markdown}")


@scenarios.command()
@click.option("--types", default="", help="Comma-separated type ids or groups; default: all.")
@click.option("--split", type=click.Choice(SPLITS), default=None)
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("scenarios.html"),
    show_default=True,
)
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
def browse(types: str, split: str | None, out: Path, workers: int) -> None:
    """Write one page to look at the data set: types, places, scenes, certificates. At most 20 MB, opens from disk."""
    from tsbench.report.page.dataset import write_dataset_page  # brings pictures
    from tsbench.run.plan import choose_types
    from tsbench.signs.catalog import load_catalog

    chosen = set(choose_types(words_of(types), load_catalog()))
    rows = [s for s in _all_rows(split) if s.scenario_type in chosen]
    with _progress() as bar:
        task = bar.add_task("maps", total=None)
        size = write_dataset_page(
            rows, out, workers, lambda done, of: bar.update(task, completed=done, total=of)
        )
    click.echo(f"{out}: {len(rows):,} scenarios, {size / 1e6:.1f} MB")


@scenarios.command()
@click.option("--split", type=click.Choice(SPLITS), default=None)
@click.option("--scenes", type=click.IntRange(1), default=300, help="Driven for the cruise speed.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("analyses"), show_default=True, metavar="DIR",
    help="Folder for calibration.csv, .tex, .png and .svg.",
)  # fmt: skip
def calibration(split: str | None, scenes: int, out: Path) -> None:
    """Initial speed, cruise speed and density against nuPlan's: KS distances and a figure of the CDFs."""
    import numpy as np

    from tsbench.cli.analyse import write_files
    from tsbench.dataset.scenes.calibration import calibrate, driven_speeds, grid_speeds, sample_rows
    from tsbench.report.analyses.calibration import calibration as compared
    from tsbench.report.analyses.shown import print_analysis
    from tsbench.scenarios.certificates import certificates_path, read_certificates
    from tsbench.scenarios.scene_loader import SceneLoader
    from tsbench.sim.sumo import Simulation

    rows = _all_rows(split)
    names = {s.scenario_id for s in rows}
    proven = [c for c in read_certificates(certificates_path()) if c.scenario_id in names]
    densities = np.array([c.realised_density for c in proven if c.asked_density])
    chosen = sample_rows(rows, scenes)
    with _progress() as bar:
        task = bar.add_task("drive", total=len(chosen))
        sim = Simulation()
        cruise = driven_speeds(chosen, sim, SceneLoader(), lambda n: bar.update(task, completed=n))
        sim.close()
    analysis = compared(calibrate(grid_speeds(rows), cruise, densities), split)
    print_analysis(analysis, table_console())
    write_files(analysis, out)
