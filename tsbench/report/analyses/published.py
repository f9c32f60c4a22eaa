"""The table that the reference published (published_results.csv), to stand beside one's own figures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.records import SIGNED_ONES
from tsbench.report.analyses.model import ALL
from tsbench.signs.catalog import load_catalog

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


def is_whole(p: PlannerSummary, panel: str) -> bool:
    """Has a planner signed episodes of every type of a panel? Published figures are of whole panels alone."""
    driven = p.scores[SIGNED_ONES].types if SIGNED_ONES in p.scores else {}
    return all(kind.id in driven for kind in load_catalog().types if panel in (ALL, kind.group))


def scd_beside(p: PlannerSummary, panel: str) -> float | None:
    """The published SCD (%) to stand beside a planner's own; None where its episodes are a selection of the types."""
    return published_scd(p.planner, panel) if is_whole(p, panel) else None


def metric_beside(p: PlannerSummary, metric: str) -> float | None:
    """The published figure of a conventional metric, likewise."""
    return published_metric(p.planner, metric) if is_whole(p, ALL) else None


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
