"""Episodes of a run as files of some kind: one by its name, or all of a selection in parallel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tsbench.episode.trace import Trace, find_trace, read_trace
from tsbench.report.video.bulk import Counts, Job, Progress, make_files
from tsbench.report.video.selection import Chosen, Selection, select_traces
from tsbench.scenarios.scene_loader import load_scene
from tsbench.sim.scene import Scene


@dataclass(frozen=True, slots=True)
class FileKind:
    """Files are in RUN/folder/PLANNER/SCENARIO+suffix. write: makes one, whole or not at all."""

    folder: str
    suffix: str
    write: Callable[[Trace, Scene, Path], None]

    def path(self, folder: Path, trace: Path) -> Path:
        """Where below a folder the file of a trace is."""
        return folder / trace.parent.name / f"{trace.stem}{self.suffix}"

    def make(self, trace: Trace, path: Path) -> None:
        """Make the file of a trace. Raises InputError for a scene that is no longer there."""
        self.write(trace, load_scene(trace.spec), path)


def make_one(run: Path, episode: str, kind: FileKind, out: Path | None) -> Path:
    """Make the file of an episode; returns where it is. Raises InputError."""
    source = find_trace(run, episode)
    path = kind.path(run / kind.folder, source) if out is None else out
    kind.make(read_trace(source), path)
    return path


def make_selected(
    run: Path, selection: Selection, kind: FileKind, out: Path | None, workers: int, progress: Progress
) -> tuple[Counts, Chosen]:
    """Make the files of all selected episodes below the folder `out` (default: in the run) that are not there yet."""
    chosen = select_traces(run, selection)
    folder = run / kind.folder if out is None else out
    jobs = [Job(trace, kind.path(folder, trace)) for trace in chosen.traces]
    return make_files(jobs, kind.make, workers, progress), chosen
