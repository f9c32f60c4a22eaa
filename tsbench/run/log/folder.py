"""The run folder: opened, checked, continued; what does not belong is named, and never deleted or trusted.

`Later`: what the planners opened and left in episodes, which files the run knows them by, and may they remember?
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, is_tmp, write_atomic, write_json
from tsbench.core.machine import MemoryUse
from tsbench.core.paths import expanded
from tsbench.core.text import written_out
from tsbench.episode.trace import trace_path
from tsbench.run import opened_files
from tsbench.run.edition import LOCAL
from tsbench.run.log.journal import FOLDER as ASIDE
from tsbench.run.log.journal import JOURNAL, Content, Journal, Key, Quarantine, belongs, file_hashes, open_locked
from tsbench.run.log.manifest import NAME, Manifest, difference, identity, planners_of, read_manifest, timestamp
from tsbench.run.log.read import RESCORED
from tsbench.run.log.record import TABLES, Record
from tsbench.run.planner_info import PlannerInfo, check_unchanged, files_place

if TYPE_CHECKING:
    from tsbench.metrics.aggregate import Summary


@dataclass
class _Told:
    """place: where the planner's files lie. opened: lines of `opened_files.hashes` by name; left: as in records."""

    place: Path | None
    opened: dict[str, str] = field(default_factory=dict)
    left: dict[str, None] = field(default_factory=dict)


class Later:
    """Of each planner the files that its episodes have read, and what they have left outside their processes."""

    def __init__(self, planners: Sequence[PlannerInfo]) -> None:
        self._planners = {planner.name: planner for planner in planners}
        self._told: dict[str, _Told] = {}

    def take(self, planner: str, opened: Iterable[str], left: Iterable[str]) -> None:
        """Add what stands in a line of the journal or in a manifest."""
        opened, left = list(opened), list(left)
        if opened or left:
            told = self._of(planner)
            told.opened.update((line.partition("  ")[2], line) for line in opened)
            told.left.update(dict.fromkeys(left))

    def take_all(self, entries: Iterable[Mapping[str, Any]]) -> None:
        for entry in entries:
            if entry["planner"] in self._planners:
                self.take(entry["planner"], entry["opened"], entry["left"])

    def hashed(self, record: Record) -> Record:
        """A record with hashes for the names of the files that were opened; they are computed once in a run."""
        if not (record.opened or record.left):
            return record
        name = record.row["planner"]
        told = self._of(name)
        new = {one: told.place / expanded(one) if told.place else expanded(one) for one in record.opened}
        unknown = [str(path) for one, path in new.items() if one not in told.opened]
        found = opened_files.hashes(unknown, told.place)
        self.take(name, found, record.left)
        return replace(record, opened=tuple(told.opened[one] for one in record.opened if one in told.opened))

    def told(self) -> list[dict[str, Any]]:
        """As it stands in a manifest."""
        return [
            {"planner": name, "opened": sorted(told.opened.values()), "left": sorted(told.left)}
            for name, told in sorted(self._told.items())
        ]

    def check(self) -> None:
        """Raises InputError where a file that was read is another now; what the planner wrote by itself may be."""
        for name, told in self._told.items():
            wrote = {expanded(text.partition(" ")[2]) for text in told.left}
            place = told.place or Path()
            kept = tuple(line for one, line in told.opened.items() if place / expanded(one) not in wrote)
            check_unchanged(replace(self._planners[name], code_sha256=None, opened=kept), None, told.place)

    def _of(self, planner: str) -> _Told:
        if planner not in self._told:
            try:
                place = files_place(self._planners[planner].spec)
            except InputError:
                place = None
            self._told[planner] = _Told(place)
        return self._told[planner]


SUMMARY, TABLES_TEXT = "summary.json", "summary.md"
TRACES, ERRORS = "traces", "errors"
# What tsbench itself puts into a run folder; pictures and reports come from other commands.
_FILES = frozenset((NAME, JOURNAL, SUMMARY, TABLES_TEXT, "report.html", RESCORED, *TABLES))
_FOLDERS = frozenset((ASIDE, TRACES, ERRORS, "pictures", "exports", "report", "tensorboard"))


# What a continued run takes over from its earlier sessions.
_KEPT = ("started", "sessions", "status", "finished", "counts", "files", "later")


class RunFolder:
    """A folder that this process writes to. journal: None where the run had already been completed.

    notices: lines about what was found that should not be there. It is set aside; only beside a complete run,
    whose folder nothing changes any more, it stays where it is.
    """

    def __init__(self, path: Path, manifest: Manifest, keys: Sequence[Key], overwrite: bool = False) -> None:
        """Open `path` for the run of `manifest`; `keys` are its episodes. overwrite: first remove a run that is there.

        Raises InputError: the folder holds another run or other things, is in use, or cannot be written.
        """
        self.path, self.notices = path, list[str]()
        self.journal: Journal | None = None
        self._keys = keys
        self._traced: set[Path] = set()
        self._aside = Quarantine(path)
        with io_errors_as_input_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            removed = overwrite and _remove_run(path)
            old = None if removed else _same_run(path, manifest)
            kept = {key: old[key] for key in _KEPT if key in old} if old else {}
            if old is not None and str(old.get("edition", "")).endswith(LOCAL):
                # Some of its rows are of changed code.
                kept["edition"] = old["edition"]
            self.manifest = {**manifest, **kept}
            self._later = Later(planners_of(manifest))
            if self.manifest["status"] == "complete":
                self._later.take_all(self.manifest.get("later", []))
                self._check_complete()
            else:
                self._take_over()
            try:
                self.check_later()
            except InputError:
                self.close()
                raise
            if self.journal is not None:
                self.manifest.update(status="running", finished=None)
                self.manifest["sessions"].append({"started": timestamp(), "finished": None, "status": "running"})
                write_json(path / NAME, self.manifest)

    def keep(self, record: Record) -> None:
        """Write down one episode: first its error's story, then the line that makes it finished."""
        assert self.journal is not None
        row = record.row
        if record.trace_sha256 is None:
            path = trace_path(self.path, row["planner"], row["scenario_id"])
            if path.exists():
                self._aside.move(path, "its episode was run once more, and left no trace")
        if record.detail:
            names = ("planner", "scenario_id", "outcome", "error")
            write_error(self.path, record, "".join(f"{name}: {row[name]}\n" for name in names) + "\n")
        self.journal.append(self._later.hashed(record))
        self.manifest["later"] = self._later.told()

    def check_later(self) -> None:
        """Raises InputError where a file that a planner opened in an episode is another now."""
        self._later.check()

    def end(self, status: str, summary: Summary | None, errors: int, memory: Sequence[MemoryUse]) -> None:
        """Write summary and manifest; the journal goes when everything in it stands in the tables."""
        assert self.journal is not None
        with io_errors_as_input_errors(self.path):
            if summary is None:
                # One of an earlier session would not belong to these tables.
                for name in (SUMMARY, TABLES_TEXT):
                    (self.path / name).unlink(missing_ok=True)
            else:
                write_atomic(self.path / SUMMARY, summary.to_json().encode())
            for path in _foreign(self.path):
                if is_tmp(path.name):
                    self._aside.move(path, "half-written by a worker that ended")
            self.manifest.update(
                status=status,
                finished=timestamp(),
                counts={"asked": len(self._keys), "finished": len(self.journal.done), "errors": errors},
                files=file_hashes(self.path),
            )
            self.manifest["sessions"][-1].update(
                finished=timestamp(), status=status, workers=[asdict(use) for use in memory]
            )
            write_json(self.path / NAME, self.manifest)
            if status == "complete":
                (self.path / JOURNAL).unlink()

    def close(self) -> None:
        if self.journal is not None:
            self.journal.close()

    def _check_complete(self) -> None:
        """The tables are those that the run wrote; foreign files are named."""
        now = file_hashes(self.path)
        for name, recorded in self.manifest["files"].items():
            if now.get(name) != recorded:
                raise InputError(
                    f"{self.path / name}: is not the file that the run wrote (SHA-256 differs); "
                    "restore it, or run again into another folder"
                )
        journal = self.path / JOURNAL
        if journal.is_file() and belongs(journal, identity(self.manifest)):
            # All that it says stands in the tables: the run was killed just before this line.
            journal.unlink()
        expected = self._paths(self._keys)
        foreign = [path for path in _foreign(self.path) if path not in expected]
        foreign += [journal] if journal.exists() else []
        self.notices = [f"{path}: does not belong to this run; left alone, not used" for path in foreign]

    def _take_over(self) -> None:
        """Trust the finished episodes that have all that they should have; set aside all that is not theirs."""
        run, aside = identity(self.manifest), self._aside
        self.journal = Journal(self.path / JOURNAL, self._keys, run, aside, self._has_its_trace)
        finished = self._paths(self.journal.done, traces=False) | self._traced
        possible = self._paths(self._keys)
        for path in _foreign(self.path):
            if is_tmp(path.name):
                aside.move(path, "half-written")
            elif path in possible and path not in finished:
                aside.move(path, "its episode has no finished record and will be run again")
            elif path not in finished:
                aside.move(path, "does not belong to this run")
        self.notices = aside.notices()

    def _has_its_trace(self, content: Content) -> bool:
        wanted = content["trace"]
        if wanted is None:
            return self._noted(content)
        path = trace_path(self.path, content["row"]["planner"], content["row"]["scenario_id"])
        if not path.is_file():
            return False
        if hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
            self._aside.move(path, "is not the trace that the run wrote (SHA-256 differs)")
            return False
        self._traced.add(path)
        return self._noted(content)

    def _noted(self, content: Content) -> bool:
        self._later.take(content["row"]["planner"], content.get("opened", []), content.get("left", []))
        return True

    def _paths(self, keys: Iterable[Key], traces: bool = True) -> set[Path]:
        found = {error_path(self.path, *key) for key in keys}
        return found | {trace_path(self.path, *key) for key in keys} if traces else found


def check_folder(path: Path, contract: str, effective: Mapping[str, Any]) -> None:
    """What can be said of a folder before anything is started: InputError where it is no place for this run."""
    with io_errors_as_input_errors(path):
        if path.exists():
            _same_run(path, {"contract": contract, "effective": effective})


def _same_run(path: Path, new: Mapping[str, Any]) -> Manifest | None:
    """The manifest of an earlier session of this run, None if there was none."""
    old = read_manifest(path)
    if old is None:
        # What a run leaves that was killed before it could write its manifest.
        if any(not is_tmp(p.name) and p.name not in (JOURNAL, ASIDE) for p in path.iterdir()):
            raise InputError(f"{path}: is neither empty nor a run folder; choose another with --out")
        return None
    differs = difference(old, new)
    if differs is not None:
        raise InputError(
            f"{path}: holds another run: {differs}; choose another folder with --out, or drive it anew with --overwrite"
        )
    return old


def _remove_run(path: Path) -> bool:
    """Remove what tsbench has put into a run folder; what was set aside stays. False where it is no run folder.

    The manifest goes last: a folder that has one is known for a run's. Raises InputError where a run is writing.
    """
    if read_manifest(path) is None:
        return False
    lock = open_locked(path / JOURNAL, os.O_CREAT)
    try:
        for name in sorted(_FOLDERS - {ASIDE}):
            if (path / name).is_dir() and not (path / name).is_symlink():
                shutil.rmtree(path / name)
        for name in (*sorted(_FILES - {NAME}), NAME):
            (path / name).unlink(missing_ok=True)
    finally:
        os.close(lock)
    return True


def error_path(run: Path, planner: str, scenario_id: str) -> Path:
    """Where the story of a failed episode stands: beside the traces, under the same names."""
    trace = trace_path(run, planner, scenario_id)
    return run / ERRORS / trace.parent.name / f"{trace.name.removesuffix('.parquet')}.txt"


def write_error(run: Path, record: Record, head: str = "") -> None:
    """Write the story of a failed episode down, below its head, with control characters written out."""
    path = error_path(run, record.row["planner"], record.row["scenario_id"])
    with io_errors_as_input_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, written_out(f"{head}{record.detail.rstrip()}\n").encode())


def _foreign(folder: Path) -> list[Path]:
    """Files with foreign names, and all traces and errors, for the caller to judge; sorted."""
    found = [
        path
        for path in sorted(folder.iterdir())
        if not (path.is_file() and path.name in _FILES) and not (path.is_dir() and path.name in _FOLDERS)
    ]
    for name in (TRACES, ERRORS):
        if (folder / name).is_dir():
            found += [path for path in sorted((folder / name).rglob("*")) if not path.is_dir()]
    return found
