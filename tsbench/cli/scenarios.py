"""`tsbench scenarios`: build, list, show, open, verify, stats, browse, calibration."""

from __future__ import annotations

import shlex
import subprocess
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np

from tsbench.cli import EXIT_FAILED, options
from tsbench.cli.analyse import out as analysis_out
from tsbench.cli.console import bars, print_table, show_analysis
from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.make.certify.certifier import draw_sample, recertify
from tsbench.make.city import sources_dir
from tsbench.make.scenes.overview import build_report, dataset_tables, report_file, shown_reason, type_stats
from tsbench.make.scenes.verify import (
    finding_counts,
    lint_rows,
    verify_certificates,
    verify_pairs,
    verify_rows,
    verify_split,
)
from tsbench.metrics.calibration import calibrate, driven_speeds, grid_speeds, sample_rows
from tsbench.report.wording import scene_facts
from tsbench.run.edition import earlier_splits
from tsbench.scenarios.certificates import certificates_of
from tsbench.scenarios.data_set import SPLITS, DataSet
from tsbench.scenarios.scene_loader import SceneLoader, load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import check_files
from tsbench.signs.countries import Country
from tsbench.sim.sumo import Simulation


def _find(data: DataSet, scenario_id: str) -> ScenarioSpec:
    for spec in options.rows_of(data, None):
        if spec.scenario_id == scenario_id:
            return spec
    raise InputError(f"no scenario {scenario_id!r} (tsbench scenarios list names them)")


def _end(rows: int, problems: list[tuple[str, str]], what: str) -> None:
    """A line for each problem; exit code 1 if there is one."""
    for name, problem in problems:
        click.echo(f"{name}: {problem}")
    click.echo(f"{rows} rows, {len(problems)} {what}")
    if problems:
        raise SystemExit(EXIT_FAILED)


@click.group()
def scenarios() -> None:
    """Build and inspect the scenario tables and scene files."""


@scenarios.command()
@options.types
@click.option("--split", "splits", type=click.Choice(SPLITS), multiple=True, help="Default: all.")
@options.made_city
@options.osm
@options.workers
def build(data: DataSet, types: tuple[str, ...], splits: tuple[str, ...], osm_dir: Path | None, workers: int) -> None:
    """Fill each type's quotas from the pool: tables, scene files and certificates. Resumable."""
    from tsbench.make.scenes.build import BuildRequest, build_scenarios

    chosen, root = options.types_of(data, types), data.folder / "scenarios"
    with bars() as show:
        reports = build_scenarios(
            BuildRequest(data, chosen, osm_dir or sources_dir(), root, workers, splits=splits or SPLITS), show
        )
    rows = [
        (
            r.type_id,
            r.split,
            str(sum(r.maps.values())),
            str(r.missed or "none"),
            f"{n} {what}: {shown_reason(why)}" if why else "",
        )
        for r in reports
        for what, found in (("maps", r.reasons), ("draws", r.draws))
        for why, n in (found or {"": 0}).items()
    ]
    print_table(("type", "split", "maps", "quota missed", "passed over, by reason"), rows, left=5)
    short = [f"{r.type_id} {r.split} lacks {r.short} maps" for r in reports if r.short]
    if short:
        raise InputError(f"the pool is too small: {', '.join(short)}")


@scenarios.command()
@options.types
@options.split(made=True)
@click.option("--each", type=options.POSITIVE, metavar="N", help="N pairs of each type, drawn at random; default: all.")
@options.workers
def certify(data: DataSet, types: tuple[str, ...], split: str | None, each: int | None, workers: int) -> None:
    """Drive rows once more in other processes and renew their certificates. Resumable; exit code 1 if any fails."""
    rows = options.rows_of(data, split, types)
    if each is not None:
        rows = draw_sample(rows, each)
    check_files(rows, data)
    with bars() as show:
        failures = recertify(rows, data.folder / "scenarios", workers, lambda n: show("certify", n, len(rows)))
    _end(len(rows), failures, "without a valid certificate")


@scenarios.command("list")
@options.split()
@options.types
def list_(data: DataSet, split: str | None, types: tuple[str, ...]) -> None:
    """One scenario id per line."""
    for spec in options.rows_of(data, split, types):
        click.echo(spec.scenario_id)


@scenarios.command()
@click.argument("scenario_id", shell_complete=options.scenario_ids)
@options.city
@options.png("Draw the scene to this file.")
@options.caption_country
def show(data: DataSet, scenario_id: str, png: Path | None, country: Country | None) -> None:
    """A scenario as text, and as a picture."""
    spec = _find(data, scenario_id)
    scene = load_scene(data, spec)
    facts = {**{key: str(value) for key, value in asdict(spec).items()}, **scene_facts(scene, country)}
    print_table(("field", "value"), facts.items(), title=scenario_id, left=2)
    if png is not None:
        from tsbench.report.scene_pictures import render_scene_png

        render_scene_png(scene, png, scenario_id, country, spec.map_id)
        click.echo(f"picture: {png}")


@scenarios.command("open")
@click.argument("scenario_id", shell_complete=options.scenario_ids)
@options.city
@options.out("Folder for the scene's files.  [default: runs/scenes/ID]", type=options.FOLDER)
@click.option("--run", "launch", is_flag=True, help="Start sumo-gui too.")
def open_(data: DataSet, scenario_id: str, out: Path | None, launch: bool) -> None:
    """Write a scene's files into a folder, and print the sumo-gui command that opens them."""
    scene = load_scene(data, _find(data, scenario_id))
    folder = out or Path("runs/scenes") / scenario_id
    files = {folder / file.path.name.removesuffix(".gz"): file.content for file in (scene.net, scene.additional)}
    try:
        for path, content in files.items():
            write_atomic(path, content)
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
@options.split(made=True)
def verify(data: DataSet, split: str | None) -> None:
    """Check hashes, files and scenes of all rows; exit code 1 and one line per problem."""
    rows = options.rows_of(data, split)
    with bars() as show:
        problems = verify_rows(rows, SceneLoader(data), lambda n: show("verify", n, len(rows)))
    # A mirrored data set's proofs are those of the one that it mirrors.
    stored = DataSet(data.city)
    proofs, tables = certificates_of(stored), options.rows_of(stored, split)
    problems += [*verify_split(tables, stored.pool_path), *verify_pairs(tables, proofs)]
    problems += verify_certificates(tables, proofs, earlier_splits(stored))
    _end(len(rows), problems, "problems")


@scenarios.command()
@options.types
@options.split(made=True)
@click.option("--each", type=options.POSITIVE, metavar="N", help="N pairs of each type, drawn; default: all.")
def lint(data: DataSet, types: tuple[str, ...], split: str | None, each: int | None) -> None:
    """Check where plates stand (sign_catalog/places.yaml) and whether vehicles break them; exit code 1 if so."""
    rows = options.rows_of(data, split, types)
    rows = rows if each is None else draw_sample(rows, each)
    with bars() as show:
        found = lint_rows(rows, SceneLoader(data), lambda n: show("lint", n, len(rows)))
    table = [tuple(map(str, line)) for line in finding_counts(found)]
    print_table(("kind", "signs", "plates", "targets", "rows"), table, left=2)
    _end(len(rows), [(f.scenario_id, str(f)) for f in found], "findings")


@scenarios.command()
@options.city
def stats(data: DataSet) -> None:
    """Rows, maps, unique places, certificates and quotas per type and split."""
    for table in dataset_tables(type_stats(data, options.rows_of(data, None)), build_report(report_file(data))):
        show_analysis(table, None)


@scenarios.command()
@options.types
@options.split()
@options.out("The page to write.", "scenarios.html", type=options.FILE)
@options.workers
def browse(data: DataSet, types: tuple[str, ...], split: str | None, out: Path, workers: int) -> None:
    """Write one page to look at the data set: types, places, scenes, certificates. At most 20 MB, opens from disk."""
    from tsbench.make.dataset_page import write_dataset_page  # brings pictures

    rows = options.rows_of(data, split, types)
    with bars() as show:
        size = write_dataset_page(data, rows, out, workers, lambda done, of: show("maps", done, of))
    click.echo(f"{out}: {len(rows):,} scenarios, {size / 1e6:.1f} MB")


@scenarios.command()
@options.split()
@options.count("--limit", default=300, help="Driven for the cruise speed.")
@analysis_out("calibration.csv, .tex, .md, .png and .svg")
def calibration(data: DataSet, split: str | None, limit: int, out: Path) -> None:
    """Initial speed, cruise speed and density against nuPlan's: KS distances and a figure of the CDFs."""
    from tsbench.report.analyses.traffic_calibration import calibration as compared

    rows = options.rows_of(data, split)
    names = {s.scenario_id for s in rows}
    proven = [c for c in certificates_of(data) if c.scenario_id in names]
    densities = np.array([c.realised_density for c in proven if c.asked_density])
    chosen = sample_rows(rows, limit)
    with bars() as show:
        sim = Simulation()
        cruise = driven_speeds(chosen, sim, SceneLoader(data), lambda n: show("drive", n, len(chosen)))
        sim.close()
    show_analysis(compared(calibrate(grid_speeds(rows), cruise, densities), split), out)
