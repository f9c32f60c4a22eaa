"""Runs from Python: drive planners, read run folders, compare, look at episodes."""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.core.errors import InputError
from tsbench.core.extras import load
from tsbench.run.log.manifest import floors_of
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.log.record import Row
from tsbench.run.log.tables import read_table
from tsbench.run.plan import BOTH, Request
from tsbench.run.session import Options, ProgressListener
from tsbench.run.session import run as run_session

if TYPE_CHECKING:
    import pandas as pd

VIOLATIONS = "violations.parquet"


class Silent:
    """A listener that says nothing."""

    def notice(self, line: str) -> None: ...

    def begin(self, asked: Mapping[str, int], done: Iterable[Row]) -> None: ...

    def episode(self, row: Row) -> None: ...

    def end(self) -> None: ...


@dataclass(frozen=True)
class Picture:
    """A frame or a film, shown by notebooks. content: the file's bytes; kind: png or gif."""

    content: bytes
    kind: str

    def _repr_mimebundle_(self, **_: Any) -> dict[str, bytes]:
        return {f"image/{self.kind}": self.content}

    def save(self, path: str | Path) -> None:
        """Write the file."""
        Path(path).write_bytes(self.content)


class Run:
    """A run folder. Tables are pandas data frames, read when they are asked for.

    path: the folder; edition, contract: what its scores compare with; planners: their names in the records.
    """

    def __init__(self, path: str | Path) -> None:
        self._stored: StoredRun = read_run(Path(path))
        self.path = self._stored.path
        self.edition, self.contract = self._stored.edition, self._stored.contract
        self.planners = tuple(self._stored.asked)

    def __repr__(self) -> str:
        return f"Run({str(self.path)!r}: {', '.join(self.planners)}; {len(self._stored.episodes)} episodes)"

    @property
    def episodes(self) -> pd.DataFrame:
        """One row per episode: scenario, outcome, SCD, metrics (columns: docs/run.md)."""
        return _pandas(self._stored.episodes)

    @property
    def violations(self) -> pd.DataFrame:
        """One row per violation: clause, time, place, value and threshold, sentence."""
        return _pandas(read_table(self.path / VIOLATIONS))

    def summary(self) -> pd.DataFrame:
        """SCD in % with 95 % intervals. Columns: planner; figure (paired_scd, signed_scd, contrast_scd); over (all, a
        group, a type); value, low, high, NaN where there is none; n; places.

        Raises InputError for a run with missing episodes: continue it.
        """
        from tsbench.metrics.aggregate import summarise

        stored = self._stored
        told = summarise(
            stored.episodes, contract_hash=stored.contract, edition=stored.edition, asked=stored.asked,
            floors=floors_of(stored.manifest),
        )  # fmt: skip
        rows = []
        for planner in told.planners:
            for figure, scores in planner.scores.items():
                for over, twice in {**scores.panels("all"), **scores.types}.items():
                    e = twice.main
                    rows.append((planner.planner, figure, over, e.value, e.low, e.high, e.n, e.clusters))
        return _frame(rows, "planner", "figure", "over", "value", "low", "high", "n", "places")

    def compare(self, other: Run | str | Path, planner: str = "", other_planner: str = "") -> pd.DataFrame:
        """Another run's planner (B) against this one's (A) over the scenarios that both drove.

        Columns: figure, over, a, b, difference (B - A, points) with low and high, won, lost, p (exact McNemar, types
        after Holm). Raises InputError for different contracts or scenarios, and where a run has several planners and
        none is named.
        """
        from tsbench.report.tables.compare import compare_runs

        there = other.path if isinstance(other, Run) else Path(other)
        sides = (_side(self.path, planner), _side(there, other_planner))
        matched = compare_runs(*sides, force=False, allow_partial=False)
        rows = []
        for figure, scores in matched.comparison.scores.items():
            for over, twice in {**scores.panels("all"), **scores.types}.items():
                d = twice.main
                p = d.p if d.p_holm is None else d.p_holm
                rows.append((figure, over, d.a, d.b, d.value, d.low, d.high, d.n, d.won, d.lost, p))
        return _frame(rows, "figure", "over", "a", "b", "difference", "low", "high", "n", "won", "lost", "p")

    def show(self, episode: str, film: bool = False, time: float | None = None) -> Picture:
        """A frame of a traced episode, or a film of it.

        episode: `scenario_id`, or `planner/scenario_id`. time: the frame's moment in s, else the first violation, else
        half-way. Raises InputError for an episode without a trace.
        """
        from tsbench.report.episode_files import make_one
        from tsbench.report.video.render import picture_kind

        kind = "gif" if film else "png"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"episode.{kind}"
            make_one(self.path, episode, picture_kind(kind, path, time), path)
            return Picture(path.read_bytes(), kind)


def evaluate(
    planner: str | type | Sequence[str | type], *, split: str = "dev", types: Sequence[str] = (),
    half: str = BOTH, variants: str = "all", limit: int | None = None, out: str | Path | None = None,
    trace: str = "violations", workers: int | None = None, mask_signs: bool = False,
    listener: ProgressListener | None = None,
) -> Run:  # fmt: skip
    """Drive planners as `tsbench run` does, in processes of their own; the same call again continues the run.

    planner: a registered name, "pkg.module:Class", "file.py:Class", a class at the top level of a file, or several
    of them. Other options are those of the command. listener: is told how it goes. Raises InputError for wrong
    options, and KeyboardInterrupt where it was interrupted; finished episodes are kept.
    """
    asked = [planner] if isinstance(planner, str | type) else list(planner)
    request = Request(tuple(map(spec_of, asked)), split, tuple(types), limit, variants, half)
    options = Options(
        request=request, workers=workers, out=None if out is None else Path(out), trace=trace, mask_signs=mask_signs,
    )  # fmt: skip
    ended = run_session(options, Silent() if listener is None else listener)
    if ended.status == "interrupted":
        raise KeyboardInterrupt(f"{ended.folder}: {ended.finished} of {ended.asked} episodes finished")
    return Run(ended.folder)


def load_run(path: str | Path) -> Run:
    """A run folder. Raises InputError: no run, another schema version, torn or exchanged tables."""
    return Run(path)


def spec_of(planner: str | type) -> str:
    """How a planner is named on the command line. Raises InputError for a class that no other process could import."""
    if isinstance(planner, str):
        return planner
    try:
        file = Path(inspect.getfile(planner))
    except (OSError, TypeError):
        file = Path()
    if not file.is_file() or "." in planner.__qualname__:
        raise InputError(
            f"planner {planner.__qualname__}: episodes are driven in other processes, which cannot import it; "
            "write it to a file, at its top level, and give file.py:Class"
        )
    return f"{file}:{planner.__name__}"


def _pandas(table: Any) -> pd.DataFrame:
    load("pandas")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def _frame(rows: list[tuple[Any, ...]], *columns: str) -> pd.DataFrame:
    """Figures that there are not are NaN."""
    numbers = {"value", "low", "high", "a", "b", "difference", "p"}
    return load("pandas").DataFrame(rows, columns=columns).astype(dict.fromkeys(numbers & {*columns}, float))


def _side(path: Path, planner: str) -> str:
    return f"{path}:{planner}" if planner else str(path)
