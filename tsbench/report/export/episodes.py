"""Episodes of a run as files of another format: one by its name, or all of a selection in parallel."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from tsbench.extras import load
from tsbench.report.bulk import Job, Progress, Tally, make_files
from tsbench.report.selection import Chosen, Selection, select_traces
from tsbench.run.trace import Trace, find_trace, read_trace
from tsbench.scenarios.load import load_scene
from tsbench.sim.scene import Scene

# By format: where its writer is, and its files' suffix.
WRITERS = {
    "commonroad": ("tsbench.report.export.commonroad:write_commonroad", ".xml"),
    "mcap": ("tsbench.report.export.recording:write_recording", ".mcap"),
}
FORMATS = tuple(WRITERS)


def export_episode(run: Path, episode: str, kind: str, out: Path | None) -> Path:
    """Write an episode; returns the file, by default RUN/exports/PLANNER/SCENARIO.SUFFIX. Raises InputError."""
    source = find_trace(run, episode)
    path = _path(run / "exports", source, kind) if out is None else out
    _writer(kind)  # here, where its lack is one line
    _write(read_trace(source), path, kind)
    return path


def export_selection(
    run: Path, selection: Selection, kind: str, out: Path | None, workers: int, progress: Progress
) -> tuple[Tally, Chosen]:
    """Write all selected episodes below the folder `out` (default: RUN/exports) that are not there yet."""
    _writer(kind)
    chosen = select_traces(run, selection)
    folder = run / "exports" if out is None else out
    jobs = [Job(trace, _path(folder, trace, kind)) for trace in chosen.traces]
    return make_files(jobs, partial(_write, kind=kind), workers, progress), chosen


def _path(folder: Path, trace: Path, kind: str) -> Path:
    return folder / trace.parent.name / f"{trace.stem}{WRITERS[kind][1]}"


def _writer(kind: str) -> Callable[[Trace, Scene, Path], None]:
    """The format's writer; InputError where the extra that it needs is not installed."""
    module, _, name = WRITERS[kind][0].partition(":")
    writer: Callable[[Trace, Scene, Path], None] = getattr(load(module), name)
    return writer


def _write(trace: Trace, path: Path, kind: str) -> None:
    _writer(kind)(trace, load_scene(trace.spec), path)
