"""What a run ends with, on one screen: each planner's headline, and how its episodes failed.

All figures stand in the run's `summary.md`. A failed episode is one without SCD.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa

from tsbench.core.text import one_line
from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.scd_records import PARTS
from tsbench.report.analyses.analysis import DASH
from tsbench.report.analyses.columns import NAMES, panels_of, present_panels

# Causes of a planner's failures that are told with an example, and characters of an exception.
_MOST_CAUSES, _MOST_TEXT = 5, 300
_COLUMNS = ("planner", "scenario_id", "outcome", "error", "scd", "violation_clause")


def headline(planners: Sequence[PlannerSummary]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table: each planner's primary figure, %, over all types with its interval, and by group."""
    panels = present_panels(planners)
    part = next(part for part in PARTS if any(part in p.scores for p in planners))
    rows = []
    for p in planners:
        figures = panels_of(p, part)
        cells = [_text(figures.get(panel), interval=not k) for k, panel in enumerate(panels)]
        rows.append([p.label, *cells])
    return [f"{NAMES[part]}, %", *panels], rows


def _text(figure: StrictAndCompleted[Estimate] | None, *, interval: bool) -> str:
    found = None if figure is None else figure.main
    if found is None or found.value is None:
        return DASH
    ends = (found.low, found.high) if interval else (None, None)
    told = "" if None in ends else f" ({ends[0]:.1f}{DASH}{ends[1]:.1f})"
    return f"{found.value:.1f}{told}"


def failures(episodes: pa.Table, folder: Path) -> Iterator[str]:
    """Lines for each planner with failed episodes: how many and why, then an example of each cause to look at.

    folder: the run's. An episode's cause is its error, else the clause that it broke first, else how it ended.
    """
    rows = episodes.select(_COLUMNS).to_pylist()
    for planner in dict.fromkeys(row["planner"] for row in rows):
        own = [row for row in rows if row["planner"] == planner]
        failed = [(_cause(row), row) for row in own if not row["scd"]]
        if not failed:
            continue
        causes = Counter(cause for cause, _ in failed).most_common()
        told = ", ".join(f"{count} {cause}" for cause, count in causes)
        yield f"{planner}: {len(failed)} of {len(own)} episodes failed: {told}"
        for cause, _ in causes[:_MOST_CAUSES]:
            row = next(row for found, row in failed if found == cause)
            if row["error"]:
                yield f"  {cause}  {row['scenario_id']}: {one_line(row['error'])[:_MOST_TEXT]}"
            else:
                shown = shlex.join(("tsbench", "render", str(folder), f"{planner}/{row['scenario_id']}"))
                yield f"  {cause}  {shown}"


def _cause(row: dict[str, str | None]) -> str:
    return "error" if row["error"] else row["violation_clause"] or str(row["outcome"])
