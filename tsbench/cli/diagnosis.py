"""The checks of `tsbench doctor`: Python, packages, SUMO, the data, the machine, and programs that some commands need.

SUMO and torch can crash or take much memory: a process of their own loads them. Packages are imported inside the
checks, because the doctor must report where a package is missing.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.core.errors import InputError, install_command
from tsbench.core.xmlfile import sha256
from tsbench.run import edition
from tsbench.run.edition import SCORING
from tsbench.scenarios.certificates import bases, certificates_of
from tsbench.scenarios.data_set import SPLITS, DataSet
from tsbench.scenarios.map_pool import known_map_ids
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneStore, store_path

if TYPE_CHECKING:
    from packaging.requirements import Requirement

TIMEOUT_S = 120
REPAIR = "make setup in a clone; else pip install --force-reinstall tsbench tsbench-data"


class Status(StrEnum):
    """How a check ended; only `FAILED` makes the exit code 1."""

    OK = "ok"
    NOTE = "note"  # something is not there that only some need
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a check saw. remedy: what to do, "" where nothing is."""

    status: Status
    name: str
    text: str
    remedy: str = ""


def _noted(name: str, text: str, remedy: str) -> Diagnosis:
    """A note where there is a remedy, and else nothing to do."""
    return Diagnosis(Status.NOTE if remedy else Status.OK, name, text, remedy)


def installed(names: Iterable[str]) -> dict[str, str]:
    """Version by name of those that are installed."""
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def alone(code: str) -> tuple[int, str]:
    """Run code in a process of its own: (exit code, the last line that it said)."""
    try:
        done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return 1, f"no end after {TIMEOUT_S} s"
    said = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    if done.returncode < 0:
        return done.returncode, f"killed by signal {-done.returncode}"
    return done.returncode, said[-1] if said else "no words"


LEAST_PYTHON = (3, 11)
# A worker that drives `idm` was measured at 0.18 GiB, a trace at 0.12 MB: with some room, and for 5,800 scenes.
WORKER_GIB, RUN_GIB = 0.5, 1.0
_GIB = 2.0**30


def check_python() -> Iterator[Diagnosis]:
    """Version and system: death of workers is watched by means that only Linux has."""
    text = f"{platform.python_implementation()} {platform.python_version()} on {platform.platform()}"
    least = ".".join(str(n) for n in LEAST_PYTHON)
    if sys.version_info < LEAST_PYTHON:
        yield Diagnosis(Status.FAILED, "Python", text, f"install Python {least} or later")
    elif sys.platform != "linux":
        yield Diagnosis(Status.FAILED, "Python", text, "tsbench run needs Linux")
    else:
        yield Diagnosis(Status.OK, "Python", text)


def check_machine() -> Iterator[Diagnosis]:
    """Cores that this process may use, free memory for a worker on each, free disk here."""
    cores = len(os.sched_getaffinity(0))
    yield Diagnosis(Status.OK, "machine", f"{cores} cores: tsbench run starts {cores} workers unless told --workers")
    memory = _free_memory() / _GIB
    remedy = f"{cores} workers should have {WORKER_GIB * cores:.1f} GiB: run fewer with --workers"
    yield _noted("machine", f"{memory:.1f} GiB of memory free", remedy if memory < WORKER_GIB * cores else "")
    here = Path.cwd()
    disk = shutil.disk_usage(here).free / _GIB
    remedy = f"traces of a planner on the whole test split can take {RUN_GIB:.0f} GiB: write elsewhere with --out"
    yield _noted("machine", f"{disk:.1f} GiB of disk free at {here}", remedy if disk < RUN_GIB else "")


def check_tools() -> Iterator[Diagnosis]:
    try:
        import imageio_ffmpeg

        program = imageio_ffmpeg.get_ffmpeg_exe()
        done = subprocess.run([program, "-version"], capture_output=True, text=True, timeout=TIMEOUT_S, check=True)
        yield Diagnosis(Status.OK, "ffmpeg", " ".join(done.stdout.split()[:3]))
    except (ImportError, RuntimeError, OSError, subprocess.SubprocessError) as problem:
        remedy = "needed for --format mp4 only: pip install 'tsbench[video]'"
        yield Diagnosis(Status.NOTE, "ffmpeg", f"none that runs: {problem}", remedy)
    browser = next((p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name))), None)
    remedy = "" if browser else "needed for the tests of pages only; reports open in any browser"
    yield _noted("browser", browser or "no Chromium", remedy)


def check_gpu() -> Iterator[Diagnosis]:
    if not installed(("torch",)):
        remedy = f"needed for training and --device cuda only: {install_command('torch')}"
        yield Diagnosis(Status.NOTE, "torch", "not installed", remedy)
        return
    see = "torch.cuda.get_device_name(0) if torch.cuda.is_available() else ''"
    code, words = alone(f"import torch; print(torch.__version__ + '|' + ({see}))")
    number, _, gpu = words.partition("|")
    if code:
        yield Diagnosis(Status.FAILED, "torch", f"cannot be imported: {words}", REPAIR)
    elif gpu:
        yield Diagnosis(Status.OK, "torch", f"{number}, GPU: {gpu}")
    else:
        yield Diagnosis(
            Status.NOTE, "torch", f"{number}, no GPU", "learned planners run on the CPU; training takes longer"
        )


def _free_memory() -> int:
    """Bytes that a new process can have, caches included."""
    lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")) * 1024


# What users need the extras for; all others of pyproject.toml are for developers, in a clone.
_USES = {
    "report": "compare, report, view, analyse, render, pictures",
    "video": "render --format mp4",
    "make": "maps, city, scenarios build and certify",
    "learn": "train, the Gymnasium environments",
    "record": "films by Gymnasium's RecordVideo",
    "ray": "run --executor ray",
    "mcap": "export --format mcap",
    "commonroad": "CommonRoad's planner and files",
}


def check_packages() -> Iterator[Diagnosis]:
    """What the installed tsbench asks for, and the versions that are known to work together."""
    try:
        asked = requires("tsbench") or []
    except PackageNotFoundError:
        yield Diagnosis(Status.FAILED, "packages", "tsbench itself is not installed", REPAIR)
        return
    lock = Path(__file__).resolve().parents[2] / "requirements.lock"
    pins = locked(lock.read_text(encoding="utf-8")) if lock.is_file() else []
    yield from judge_packages(asked, pins, installed(r.name for r in _requirements((*asked, *pins))))


def locked(text: str) -> list[str]:
    """The requirement lines of a lock file, without their hashes."""
    return [line.rstrip(" \\") for line in text.splitlines() if line[:1].isalnum()]


def judge_packages(asked: Iterable[str], pins: Sequence[str], there: Mapping[str, str]) -> Iterator[Diagnosis]:
    """asked: requirement lines with markers; pins: of a clone's lock file. there: version by package name."""
    core: list[Requirement] = []
    extras: dict[str, list[Requirement]] = {}
    for requirement in _requirements(asked):
        marker = str(requirement.marker or "")
        extra = marker.partition('extra == "')[2].partition('"')[0]
        (extras.setdefault(extra, []) if extra else core).append(requirement)
    wrong = _unmet(core, there)
    if wrong:
        yield Diagnosis(Status.FAILED, "packages", f"not as required: {', '.join(wrong)}", REPAIR)
    else:
        yield Diagnosis(Status.OK, "packages", f"all {len(core)} required packages are there")
    for extra, wanted in sorted(extras.items()):
        use = _USES.get(extra, "developers" if pins else "")
        if not use:
            continue
        wrong = _unmet(wanted, there)
        text = f"extra {extra} (for {use}): " + (f"lacks {', '.join(wrong)}" if wrong else "complete")
        remedy = f"only if you need it: pip install 'tsbench[{extra}]'" if wrong else ""
        yield _noted("packages", text, remedy)
    pinned = [r for r in _requirements(pins) if r.marker is None or r.marker.evaluate()]
    known = [r for r in pinned if r.name in there]
    apart = [r for r in known if not r.specifier.contains(there[r.name], prereleases=True)]
    other = [f"{r.name} {there[r.name]} instead of {r.specifier}" for r in apart]
    if other:
        text = f"other versions than those known to work together: {', '.join(other)}"
        yield Diagnosis(Status.NOTE, "packages", text, f"if something fails: {REPAIR}")


def _unmet(wanted: Iterable[Requirement], there: Mapping[str, str]) -> list[str]:
    """What is not there, or of another version than asked for."""
    found = []
    for r in wanted:
        if r.name not in there:
            found.append(f"{r.name} (not there)")
        elif not r.specifier.contains(there[r.name], prereleases=True):
            found.append(f"{r.name} {there[r.name]} ({r.specifier})")
    return found


def _requirements(lines: Iterable[str]) -> list[Requirement]:
    from packaging.requirements import Requirement

    return list(map(Requirement, lines))


SAMPLE = 200


def check_sumo() -> Iterator[Diagnosis]:
    """Its packages must be of one version, and a scene of the test split must start."""
    there = installed(("libsumo", "sumolib", "eclipse-sumo"))  # the last comes with the extra `make`
    told = ", ".join(f"{name} {number}" for name, number in there.items())
    if not {"libsumo", "sumolib"} <= there.keys() or len(set(there.values())) != 1:
        yield Diagnosis(Status.FAILED, "SUMO", f"its packages do not belong together: {told}", REPAIR)
        return
    code, words = alone("from tsbench.cli.diagnosis import simulate; simulate()")
    if code:
        yield Diagnosis(Status.FAILED, "SUMO", f"{told}; a simulation does not start: {words}", REPAIR)
    else:
        yield Diagnosis(Status.OK, "SUMO", f"{told}; {words}")


def simulate() -> None:
    """Load the first scene of the test split and step it for a second; prints what it did."""
    from tsbench.sim.sumo import Simulation  # brings SUMO

    try:
        data = DataSet()
        spec = data.table("test")[0]
        scene, sim = load_scene(data, spec), Simulation()
        sim.load_scene(scene)
        for _ in range(10):
            sim.step()
        print(f"a simulation started ({spec.scenario_id}, {len(sim.fleet())} vehicles after 1 s)")
    except InputError as problem:
        sys.exit(str(problem))


def check_data() -> Iterator[Diagnosis]:
    """Catalogue, pool and tables can be read; all scene files are there, and a sample has the hashes of its rows."""
    data = DataSet()
    catalog, maps = data.catalog, known_map_ids(data.pool_path)
    signs = f"{len(catalog.signs)} signs, {len(catalog.types)} types, {len(maps)} maps"
    yield Diagnosis(Status.OK, "data", f"{data.pool_path.parent.parent}: {signs}")
    for split in SPLITS:
        path = data.table_path(split)
        if not path.is_file():
            remedy = f"needed for --split {split} only: {data.fetch_hint(split)}"
            yield Diagnosis(Status.NOTE, "data", f"{path}: not there", remedy)
            continue
        rows = sorted(data.table(split), key=lambda row: row.scenario_id)
        lost = [row for row in rows if row.map_id not in maps]
        if lost:
            text = f"{path}: map {lost[0].map_id} of {lost[0].scenario_id} is not in the pool"
            yield Diagnosis(Status.FAILED, "data", text, "fetch the repository's data again")
            continue
        yield _files(data, split, rows)


def check_edition() -> Iterator[Diagnosis]:
    """Are rules, scenes, code and versions those that were released, and are the certificates those of the rows?"""
    data = DataSet()
    earlier = edition.earlier_splits(data)
    for split in data.splits:
        if split in earlier:
            text = f"the scenes of the {split} split are of {earlier[split]}"
            yield Diagnosis(Status.NOTE, "edition", text, "tsbench scenarios build makes those of today")
            continue
        contract = edition.standing_contract(edition.contract_now(data, split))
        name = edition.edition_here(contract, data)
        text = f"{name}, contract of the {split} split {contract}"
        known = next((one for one in edition.editions() if name in (one.name, one.name + edition.LOCAL)), None)
        if known and split == "test" and known.kept(split) != contract:
            text += f"; results (scoring {known.scoring}) have {known.kept(split)}"
        remedy = ""
        if name.endswith(edition.LOCAL):
            text += ": rules, scenes, code or versions are not those released"
            remedy = "scores compare with runs of this very installation only"
        yield _noted("edition", text, remedy)
    path = data.certificates_path
    if not path.is_file():
        yield Diagnosis(Status.NOTE, "edition", f"{path}: not there", "tsbench scenarios build makes it")
        return
    there = [split for split in data.splits if split not in earlier]
    rows = [row for split in there for row in data.table(split)]
    certificates = {c.scenario_id: c for c in certificates_of(data)}
    proven = {name: certificate.basis for name, certificate in certificates.items()}
    void = [name for name, basis in bases(rows).items() if proven.get(name) != basis]
    judged = sorted({certificates[row.scenario_id].scoring for row in rows if row.scenario_id in proven})
    if void:
        text = f"{path}: {len(void)} rows without a certificate of what they are, first {void[0]}"
        yield Diagnosis(Status.FAILED, "edition", text, "tsbench scenarios certify drives them again")
        return
    text, remedy = f"{len(rows)} rows, each with a certificate of what it is", ""
    if judged not in ([], [SCORING]):
        text += f", judged by scoring {', '.join(map(str, judged))}; this is scoring {SCORING}"
        remedy = "tsbench scenarios certify drives them again"
    yield _noted("edition", text, remedy)


def _files(data: DataSet, split: str, rows: list[ScenarioSpec]) -> Diagnosis:
    """All files that the rows name are in the stores, and a sample of them has the rows' hashes."""
    store, table = SceneStore(data), f"{split}.parquet"
    folder = data.file(f"scenarios/scenes/{split}")
    if not folder.is_dir():
        # Only those of the test split come with the package.
        status = Status.FAILED if split == "test" else Status.NOTE
        return Diagnosis(status, "data", f"{folder}: no scene files here", data.fetch_hint(split))
    there = {kind: store.names(split, kind) for kind in sorted({row.pair_type for row in rows})}
    nets = {row.net: (row, row.net_sha256) for row in rows}
    named = nets | {row.additional: (row, row.additional_sha256) for row in rows}
    missing = [name for name, (row, _) in named.items() if name not in there[row.pair_type]]
    sample = [name for name in list(named)[:: max(len(named) // SAMPLE, 1)] if name not in missing]
    changed = [name for name in sample if sha256(store.read(named[name][0], name).content) != named[name][1]]
    if not missing and not changed:
        text = f"{table}: {len(rows)} scenarios, all {len(named)} scene files there, {len(sample)} hashed"
        return Diagnosis(Status.OK, "data", text)
    first = (missing or changed)[0]
    told = f"{len(missing)} scene files missing, {len(changed)} of {len(sample)} hashed ones changed"
    where = store_path(split, named[first][0].pair_type, data) / first
    remedy = "fetch the repository's data again; tsbench scenarios verify names every file"
    return Diagnosis(Status.FAILED, "data", f"{table}: {told}, first {where}", remedy)


CHECKS: Mapping[str, Callable[[], Iterator[Diagnosis]]] = {
    "Python": check_python,
    "packages": check_packages,
    "SUMO": check_sumo,
    "data": check_data,
    "edition": check_edition,
    "machine": check_machine,
    "tools": check_tools,
    "torch": check_gpu,
}


def examine() -> Iterator[Diagnosis]:
    """All checks in turn; each is done when it is asked for."""
    for name, check in CHECKS.items():
        try:
            yield from check()
        except InputError as problem:
            yield Diagnosis(Status.FAILED, name, str(problem))
        except ImportError as problem:
            yield Diagnosis(Status.FAILED, name, f"cannot be checked: {problem}", "install the missing package")
