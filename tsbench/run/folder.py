"""The run folder: opened, checked, continued; what does not belong is named, and never deleted or trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.errors import InputError
from tsbench.run.files import is_tmp, told_plainly, write_atomic, write_json
from tsbench.run.journal import Journal, Key
from tsbench.run.manifest import NAME, Manifest, difference, read_manifest, timestamp
from tsbench.run.record import Record
from tsbench.run.schema import TABLES
from tsbench.run.tables import file_hashes
from tsbench.run.trace import trace_path

if TYPE_CHECKING:
    from tsbench.metrics.aggregate import Summary

JOURNAL, SUMMARY, ASIDE = "journal.jsonl", "summary.json", "aside"
TABLES_TEXT = "summary.md"
# What tsbench itself puts into a run folder; pictures and reports come from other commands.
_OURS = frozenset(
    (
        NAME,
        JOURNAL,
        SUMMARY,
        TABLES_TEXT,
        ASIDE,
        "traces",
        "errors",
        "pictures",
        "report",
        "report.html",
        *TABLES,
    )
)


# What a continued run takes over from its earlier sessions.
_KEPT = ("started", "sessions", "status", "finished", "counts", "files")


class RunFolder:
    """A folder that this process writes to. journal: None where the run had already been completed.

    notices: lines about what was found that should not be there.
    """

    def __init__(self, path: Path, manifest: Manifest, keys: Sequence[Key]) -> None:
        """Open `path` for the run of `manifest`; `keys` are its episodes.

        Raises:
            InputError: the folder holds another run or other things, is in use, or cannot be written.
        """
        self.path, self.notices = path, list[str]()
        self.journal: Journal | None = None
        self._keys = keys
        with told_plainly(path):
            path.mkdir(parents=True, exist_ok=True)
            old = _same_run(path, manifest)
            self.manifest = manifest if old is None else {**manifest, **{key: old[key] for key in _KEPT}}
            if self.manifest["status"] == "complete":
                self._check_complete()
            else:
                self.journal = Journal(path / JOURNAL, keys, path / ASIDE)
                self._open_session()
            self._look_around()

    def keep(self, record: Record) -> None:
        """Write down one episode: first its error's story, then the line that makes it finished."""
        assert self.journal is not None
        if record.detail:
            row = record.row
            head = "".join(
                f"{name}: {row[name]}\n" for name in ("planner", "scenario_id", "outcome", "error")
            )
            path = error_path(self.path, row["planner"], row["scenario_id"])
            with told_plainly(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, f"{head}\n{record.detail.rstrip()}\n".encode(errors="replace"))
        self.journal.append(record)

    def end(self, status: str, summary: Summary | None, errors: int) -> None:
        """Write summary and manifest; the journal goes when everything in it stands in the tables."""
        assert self.journal is not None
        with told_plainly(self.path):
            if summary is None:
                # One of an earlier session would not belong to these tables.
                for name in (SUMMARY, TABLES_TEXT):
                    (self.path / name).unlink(missing_ok=True)
            else:
                write_atomic(self.path / SUMMARY, summary.to_json().encode())
            self.manifest.update(
                status=status,
                finished=timestamp(),
                counts={"asked": len(self._keys), "finished": len(self.journal.done), "errors": errors},
                files=file_hashes(self.path),
            )
            self.manifest["sessions"][-1].update(finished=timestamp(), status=status)
            write_json(self.path / NAME, self.manifest)
            if status == "complete":
                (self.path / JOURNAL).unlink()

    def close(self) -> None:
        """Let go of the folder."""
        if self.journal is not None:
            self.journal.close()

    def _open_session(self) -> None:
        self.manifest.update(status="running", finished=None)
        self.manifest["sessions"].append({"started": timestamp(), "finished": None, "status": "running"})
        write_json(self.path / NAME, self.manifest)

    def _check_complete(self) -> None:
        now = file_hashes(self.path)
        for name, recorded in self.manifest["files"].items():
            if now.get(name) != recorded:
                raise InputError(f"{self.path / name}: is not the file that the run wrote (SHA-256 differs)")
        (self.path / JOURNAL).unlink(missing_ok=True)

    def _look_around(self) -> None:
        """Name what is not ours; move our own half-written files out of the way."""
        if self.journal is not None and self.journal.set_aside is not None:
            self.notices.append(
                f"{self.path / JOURNAL}: torn or foreign lines moved to {self.journal.set_aside}"
            )
        expected = {trace_path(self.path, *key) for key in self._keys}
        expected |= {error_path(self.path, *key) for key in self._keys}
        for path in _files(self.path):
            if is_tmp(path.name):
                if self.journal is not None:
                    self._put_aside(path)
            elif path not in expected:
                self.notices.append(f"{path}: does not belong to this run; left alone, not used")

    def _put_aside(self, path: Path) -> None:
        aside = self.path / ASIDE
        aside.mkdir(exist_ok=True)
        number = 1
        while (target := aside / f"{path.name.strip('.')}-{number}").exists():
            number += 1
        path.rename(target)
        self.notices.append(f"{path}: half-written, moved to {target}")


def check_folder(path: Path, contract: str, effective: Mapping[str, Any]) -> None:
    """What can be said of a folder before anything is started: InputError where it is no place for this run."""
    with told_plainly(path):
        if path.exists():
            _same_run(path, {"contract": contract, "effective": effective})


def _same_run(path: Path, new: Mapping[str, Any]) -> Manifest | None:
    """The manifest of an earlier session of this run, None if there was none."""
    old = read_manifest(path)
    if old is None:
        if any(not is_tmp(p.name) and p.name != JOURNAL for p in path.iterdir()):
            raise InputError(f"{path}: is neither empty nor a run folder; choose another with --out")
        return None
    differs = difference(old, new)
    if differs is not None:
        raise InputError(f"{path}: holds another run: {differs}; choose another folder with --out")
    return old


def error_path(run: Path, planner: str, scenario_id: str) -> Path:
    """Where the story of a failed episode stands: beside the traces, under the same names."""
    trace = trace_path(run, planner, scenario_id)
    return run / "errors" / trace.parent.name / f"{trace.name.removesuffix('.parquet')}.txt"


def _files(folder: Path) -> list[Path]:
    """What lies in a run folder besides our own top-level names, sorted."""
    top = sorted(folder.iterdir())
    below = [p for name in ("traces", "errors") for p in sorted((folder / name).rglob("*")) if not p.is_dir()]
    return [p for p in top if p.name not in _OURS] + below
