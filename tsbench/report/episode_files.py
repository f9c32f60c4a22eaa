"""Episodes of a run as files of some kind: one by its name, or a selection in parallel; what is there is kept."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import unquote

import cv2

from tsbench.core.errors import InputError
from tsbench.core.extras import load
from tsbench.core.parallel import worker_processes
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import Trace, find_trace, read_trace, trace_path
from tsbench.run.log.read import read_run
from tsbench.run.plan import choose_types
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

_COLUMNS = ("planner", "scenario_id", "scenario_type", "outcome", "scd")


@dataclass(frozen=True, slots=True)
class Selection:
    """All that is given must hold; nothing given selects nothing.

    failures: without SCD. types: type ids and groups. planners: names in the records.
    outcomes: how the episode ended.
    """

    failures: bool = False
    types: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.failures or self.types or self.planners or self.outcomes)


@dataclass(frozen=True, slots=True)
class Chosen:
    """Traces of the selected episodes, sorted by planner and scenario; data: what they are of; untraced: how many have
    none.
    """

    data: DataSet
    traces: tuple[Path, ...]
    untraced: int


def select_traces(run: Path, selection: Selection) -> Chosen:
    """The traces of a selection. Raises InputError: no run, unknown names, nothing selected, no trace of it."""
    stored = read_run(run)
    _check_names("--planner", selection.planners, stored.asked)
    _check_names("--outcome", selection.outcomes, map(str, Outcome))
    types = set(choose_types(stored.data.catalog, selection.types))
    rows = stored.episodes.select(_COLUMNS).to_pylist()
    chosen = [
        (row["planner"], row["scenario_id"])
        for row in rows
        if row["scenario_type"] in types
        and (not selection.failures or not row["scd"])
        and (not selection.planners or row["planner"] in selection.planners)
        and (not selection.outcomes or row["outcome"] in selection.outcomes)
    ]
    if not chosen:
        raise InputError(f"{run}: none of its {len(rows)} episodes is selected")
    paths = [trace_path(run, *key) for key in sorted(chosen)]
    there = tuple(path for path in paths if path.is_file())
    if not there:
        raise InputError(
            f"{run}: none of the {len(paths)} selected episodes has a trace (tsbench run --trace all keeps them)"
        )
    return Chosen(stored.data, there, len(paths) - len(there))


def episode_name(trace: Path) -> str:
    """PLANNER/SCENARIO of a trace, as commands take it."""
    return f"{unquote(trace.parent.name)}/{unquote(trace.stem)}"


def _check_names(option: str, asked: Iterable[str], known: Iterable[str]) -> None:
    names = list(known)
    for name in asked:
        if name not in names:
            raise InputError(f"{option} {name}: there are {', '.join(names)}")


# Makes a file (the second path) from a trace; whole or not at all.
Maker = Callable[[Trace, Path], None]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Counts:
    """What came of it. failed: traces and why, in one line each. driven_s: length of the episodes made now.

    cpu_s: of all processes, the encoder's too, without their start; wall_s: from beginning to end.
    """

    made: int
    kept: int
    failed: tuple[tuple[Path, str], ...]
    driven_s: float
    cpu_s: float
    wall_s: float


def make_files(files: Mapping[Path, Path], make: Maker, workers: int, progress: Progress) -> Counts:
    """Make what is not there yet. files: by trace; progress: called with the number done and the total.

    A bad trace or scene costs its own file only. Raises TsbenchError where a process dies.
    """
    begun = time.monotonic()
    todo = [(trace, out) for trace, out in files.items() if not _is_made(out, trace)]
    kept = len(files) - len(todo)
    progress(kept, len(files))
    failed: list[tuple[Path, str]] = []
    driven = cpu = 0.0
    with worker_processes(min(workers, max(len(todo), 1)), "drawing") as pool:
        results = pool.ordered(_make, ((*job, make) for job in todo))
        for number, ((trace, _), (seconds, spent, problem)) in enumerate(zip(todo, results, strict=True), start=1):
            driven, cpu = driven + seconds, cpu + spent
            if problem:
                failed.append((trace, problem))
            progress(kept + number, len(files))
    made = len(todo) - len(failed)
    return Counts(made, kept, tuple(sorted(failed)), driven, cpu, time.monotonic() - begun)


def _is_made(out: Path, trace: Path) -> bool:
    """From this very trace? A later run may have written it anew."""
    return out.is_file() and out.stat().st_mtime >= trace.stat().st_mtime


def _make(path: Path, out: Path, make: Maker) -> tuple[float, float, str]:
    """Length of the episode and CPU time, s, and why there is no file, "" if there is; in one thread."""
    cv2.setNumThreads(1)
    before = _cpu_s()
    try:
        trace = read_trace(path)
        make(trace, out)
    except InputError as problem:
        return 0.0, 0.0, str(problem)
    return len(trace.snapshots) * DT_S, _cpu_s() - before, ""


def _cpu_s() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


@dataclass(frozen=True, slots=True)
class FileKind:
    """Files are in RUN/folder/PLANNER/SCENARIO+suffix. write: makes one, whole or not at all."""

    folder: str
    suffix: str
    write: Callable[[Trace, Scene, Path], None]

    def path(self, folder: Path, trace: Path) -> Path:
        return folder / trace.parent.name / f"{trace.stem}{self.suffix}"

    def make(self, data: DataSet, trace: Trace, path: Path) -> None:
        """Make the file of a trace. Raises InputError for a scene that is no longer there."""
        self.write(trace, load_scene(data, trace.spec), path)


def make_one(run: Path, episode: str, kind: FileKind, out: Path | None) -> Path:
    """Make the file of an episode; returns where it is. Raises InputError."""
    source = find_trace(run, episode)
    path = kind.path(run / kind.folder, source) if out is None else out
    kind.make(DataSet.in_use(), read_trace(source), path)
    return path


def make_selected(
    run: Path, selection: Selection, kind: FileKind, out: Path | None, workers: int, progress: Progress
) -> tuple[Counts, Chosen]:
    """Make the files of all selected episodes below the folder `out` (default: in the run) that are not there yet."""
    chosen = select_traces(run, selection)
    folder = run / kind.folder if out is None else out
    files = {trace: kind.path(folder, trace) for trace in chosen.traces}
    return make_files(files, partial(kind.make, chosen.data), workers, progress), chosen


# By format: where its writer is, and its files' suffix.
WRITERS = {
    "commonroad": ("tsbench.bridges.commonroad_file:write_commonroad", ".xml"),
    "mcap": ("tsbench.bridges.mcap_recording:write_recording", ".mcap"),
}
FORMATS = tuple(WRITERS)


def export_kind(name: str) -> FileKind:
    """Files of a format; InputError where the extra that its writer needs is not installed."""
    target, suffix = WRITERS[name]
    module, _, function = target.partition(":")
    return FileKind("exports", suffix, getattr(load(module), function))
