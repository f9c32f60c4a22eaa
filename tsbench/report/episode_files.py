"""Episodes of a run as files of some kind: one by its name, or a selection in parallel; what is there is kept."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2

from tsbench.core.errors import InputError, load
from tsbench.core.parallel import worker_processes
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import Trace, trace_path
from tsbench.run.log.journal import Key
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.log.record import Row
from tsbench.run.plan import choose_types
from tsbench.run.run_traces import Traces, traces_of
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

_COLUMNS = ("planner", "scenario_id", "scenario_type", "outcome", "scd")

# An episode with its scene.
Played = tuple[Trace, Scene]


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


def select_episodes(run: StoredRun, selection: Selection) -> list[Key]:
    """The episodes of a selection, sorted. Raises InputError: unknown names, or nothing selected."""
    _check_names("--planner", selection.planners, run.asked)
    _check_names("--outcome", selection.outcomes, map(str, Outcome))
    types = set(choose_types(run.data.catalog, selection.types))
    rows = run.episodes.select(_COLUMNS).to_pylist()
    chosen = [
        (row["planner"], row["scenario_id"])
        for row in rows
        if row["scenario_type"] in types
        and (not selection.failures or not row["scd"])
        and (not selection.planners or row["planner"] in selection.planners)
        and (not selection.outcomes or row["outcome"] in selection.outcomes)
    ]
    if not chosen:
        raise InputError(f"{run.path}: none of its {len(rows)} episodes is selected")
    return sorted(chosen)


def _check_names(option: str, asked: Iterable[str], known: Iterable[str]) -> None:
    names = list(known)
    for name in asked:
        if name not in names:
            raise InputError(f"{option} {name}: there are {', '.join(names)}")


Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class FileKind:
    """Files are in RUN/folder/PLANNER/SCENARIO+suffix.

    write: makes the file of a trace, a scene and a path, whole or not at all. with_other: `write` takes `beside`, too:
    of a failed half the other half's episode, where the run has that, else None.
    """

    folder: str
    suffix: str
    write: Callable[..., None]
    with_other: bool = False

    def path(self, folder: Path, key: Key) -> Path:
        name = trace_path(folder, *key)
        return folder / name.parent.name / f"{name.stem}{self.suffix}"

    def make(self, traces: Traces, row: Row, path: Path) -> Trace:
        """Make the file of an episode from its trace, which is returned. Raises InputError."""
        trace = traces.read(row["planner"], row["scenario_id"])
        played = trace, traces.loader.load(trace.spec)[0], path
        if not self.with_other:
            self.write(*played)
            return trace
        other = None if row["scd"] else traces.of_other_half(row)
        self.write(*played, beside=None if other is None else (other, traces.loader.load(other.spec)[0]))
        return trace


@dataclass(frozen=True, slots=True)
class Counts:
    """What came of it. failed: episodes (PLANNER/SCENARIO) and why, in one line each. driven_s: length of the episodes
    made now.

    cpu_s: of all processes, the encoder's too, without their start; wall_s: from beginning to end.
    """

    made: int
    kept: int
    failed: tuple[tuple[str, str], ...]
    driven_s: float
    cpu_s: float
    wall_s: float


def make_one(run: Path, episode: str, kind: FileKind, out: Path | None) -> Path:
    """Make the file of an episode; returns where it is. Raises InputError."""
    traces = Traces(read_run(run))
    row = traces.run.row(episode)
    path = kind.path(run / kind.folder, (row["planner"], row["scenario_id"])) if out is None else out
    kind.make(traces, row, path)
    return path


def make_selected(
    run: Path, selection: Selection, kind: FileKind, out: Path | None, workers: int, progress: Progress
) -> Counts:
    """Make the files of all selected episodes below the folder `out` (default: in the run) that are not there yet.

    progress: called with the number done and the total. A bad trace or scene costs its own file only. Raises
    InputError, and TsbenchError where a process dies.
    """
    begun = time.monotonic()
    folder = run / kind.folder if out is None else out
    files = {key: kind.path(folder, key) for key in select_episodes(read_run(run), selection)}
    todo = [(key, path) for key, path in files.items() if not _is_made(path, trace_path(run, *key))]
    kept = len(files) - len(todo)
    progress(kept, len(files))
    failed: list[tuple[str, str]] = []
    driven = cpu = 0.0
    with worker_processes(min(workers, max(len(todo), 1)), "drawing") as pool:
        results = pool.ordered(_make, ((run, *job, kind) for job in todo))
        for number, ((key, _), (seconds, spent, problem)) in enumerate(zip(todo, results, strict=True), start=1):
            driven, cpu = driven + seconds, cpu + spent
            if problem:
                failed.append(("/".join(key), problem))
            progress(kept + number, len(files))
    made = len(todo) - len(failed)
    return Counts(made, kept, tuple(sorted(failed)), driven, cpu, time.monotonic() - begun)


def _is_made(out: Path, trace: Path) -> bool:
    """From this very trace? A later run may have written it anew."""
    return out.is_file() and (not trace.is_file() or out.stat().st_mtime >= trace.stat().st_mtime)


def _make(run: Path, key: Key, out: Path, kind: FileKind) -> tuple[float, float, str]:
    """Length of the episode and CPU time, s, and why there is no file, "" if there is; in one thread."""
    cv2.setNumThreads(1)
    before = _cpu_s()
    try:
        traces = traces_of(run)
        trace = kind.make(traces, traces.run.row("/".join(key)), out)
    except InputError as problem:
        return 0.0, 0.0, str(problem)
    return len(trace.snapshots) * DT_S, _cpu_s() - before, ""


def _cpu_s() -> float:
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


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
