"""A run that was made: its tables, its figures, its episodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsbench.api.figure_frames import comparison_frame, episodes_frame, flips_frame, frame_of, summary_frame
from tsbench.core.errors import InputError, load
from tsbench.metrics.aggregate import summarise
from tsbench.report.compare_runs import match, side_of
from tsbench.run.log.journal import read_table
from tsbench.run.log.manifest import marks_of
from tsbench.run.log.read import read_run
from tsbench.run.options import keywords, path_of
from tsbench.run.run_traces import Traces

if TYPE_CHECKING:
    import pandas as pd

    from tsbench.api.shown import Shown


@dataclass(frozen=True)
class Compared:
    """B against A. title: what was compared, and what makes the figures no plain ones; notes: other differences.

    differences: a row for each figure and reading, with a, b, value (b - a), its interval and tests; flips: scenarios
    that one of the two passes and the other does not (`won`: B does).
    """

    title: str
    notes: tuple[str, ...]
    differences: pd.DataFrame
    flips: pd.DataFrame

    def __repr__(self) -> str:
        lost = int((~self.flips["won"]).sum()) if len(self.flips) else 0
        return f"{self.title}; {len(self.flips) - lost} won, {lost} lost"


class Run:
    """A run folder, read as it stands. The extra `report` brings pandas, which tables and figures need."""

    def __init__(self, path: str | Path) -> None:
        """Raises InputError: no run, another schema version, torn or exchanged tables."""
        self._stored = read_run(path_of("run", path))

    @property
    def path(self) -> Path:
        return self._stored.path

    @property
    def planners(self) -> tuple[str, ...]:
        """Names, as in records."""
        return tuple(self._stored.asked)

    @property
    def status(self) -> str:
        """complete, interrupted or running."""
        return str(self._stored.manifest["status"])

    @property
    def contract(self) -> str:
        return self._stored.contract

    @property
    def edition(self) -> str:
        """The contract's name, "" where it has none."""
        return self._stored.edition

    @property
    def options(self) -> dict[str, Any]:
        """What the run was asked for."""
        return dict(self._stored.manifest["asked"])

    @cached_property
    def episodes(self) -> pd.DataFrame:
        """One row for each planner and scenario (docs/reference/tables.md says what the columns are).

        `pair_type`: the type that figures count a row to. A contrast row's own type is that of its other plate.
        """
        return episodes_frame(self._stored.episodes)

    @cached_property
    def violations(self) -> pd.DataFrame:
        """One row for each event of every sign; `target`: of the sign that the scenario is about."""
        return frame_of(self._stored.violations)

    @cached_property
    def timing(self) -> pd.DataFrame:
        """One row for each episode: seconds by the clock."""
        return frame_of(read_table(self.path / "timing.parquet"))

    @keywords()
    def summary(self, *, allow_partial: bool = False) -> pd.DataFrame:
        """Every figure with its 95 % interval and what it rests on: by planner, figure, part and reading.

        Raises InputError where episodes are missing, unless partial figures are allowed.
        """
        stored = self._stored
        return summary_frame(
            summarise(
                stored.episodes,
                contract_hash=stored.contract,
                edition=stored.edition,
                asked=stored.asked,
                marks=marks_of(stored.manifest),
                allow_partial=allow_partial,
            )
        )

    @keywords()
    def compare(
        self,
        other: Run,
        *,
        planner: str | None = None,
        other_planner: str | None = None,
        force: bool = False,
        allow_partial: bool = False,
    ) -> Compared:
        """`other` (B) against this run (A), scenario by scenario. The planners are named where a run has several.

        Raises InputError, unless forced, for different contracts or scenarios.
        """
        for run, name, keyword in ((self, planner, "planner"), (other, other_planner, "other_planner")):
            if name is None and len(run.planners) != 1:
                names = ", ".join(run.planners)
                raise InputError(f"{run.path}: has planners {names}: name one, {keyword}={run.planners[0]!r}")
        a, b = side_of(self._stored, planner), side_of(other._stored, other_planner)
        found = match(a, b, force=force, allow_partial=allow_partial)
        comparison = found.comparison
        return Compared(found.title, found.notes, comparison_frame(comparison), flips_frame(comparison))

    @keywords()
    def show(self, episode: str, time: float | None = None) -> Shown:
        """A player of an episode (scenario_id or planner/scenario_id) for a notebook; `.frame` is a picture.

        time: s. An episode without a trace is driven again, and has one then. Raises InputError where it cannot be.
        """
        row, traces = self._stored.row(episode), Traces(self._stored)
        trace = traces.read(row["planner"], row["scenario_id"])
        if not row["scd"]:
            # The player shows it beside.
            traces.of_other_half(row)
        shown: Shown = load("tsbench.api.shown").Shown(self._stored, trace, time)
        return shown

    def __repr__(self) -> str:
        there, asked = len(self._stored.episodes), sum(self._stored.asked.values())
        return f"Run({str(self.path)!r}: {', '.join(self.planners)}; {there} of {asked} episodes, {self.status})"


def load_run(path: str | Path) -> Run:
    """A run folder. Raises InputError for any other path."""
    return Run(path)
