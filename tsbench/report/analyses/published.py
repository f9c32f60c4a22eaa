"""The table that the reference published (published_results.csv), to stand beside one's own figures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files

from tsbench.report.analyses.model import ALL

NOTE = (
    "published: figures of the reference's paper, from its own simulator and scenes, without intervals; its numbers of "
    "episodes are not published"
)


@cache
def published() -> Mapping[str, Mapping[str, float]]:
    """By planner, in the order of the table: every published figure (%) by its column."""
    text = files("tsbench.report.analyses").joinpath("published_results.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {
        row["planner"]: {key: float(cell) for key, cell in row.items() if key != "planner"} for row in rows
    }


def published_scd(planner: str, panel: str) -> float | None:
    """The published SCD (%) of a group or of all types; None where there is none."""
    return published().get(planner, {}).get("scd_overall" if panel == ALL else f"scd_{panel}")


def published_metric(planner: str, metric: str) -> float | None:
    """The published figure of a conventional metric, None where there is none."""
    return published().get(planner, {}).get(metric)


def in_published_order(planners: Iterable[str]) -> tuple[str, ...]:
    """Planners of the published table in its order, then the others by name."""
    rank = {name: k for k, name in enumerate(published())}
    return tuple(sorted(planners, key=lambda name: (rank.get(name, len(rank)), name)))
