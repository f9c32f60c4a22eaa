"""The study's table (published_results.csv), beside the same planners on Moscow's test split."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.resources import files

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.records import SIGNED_ONES
from tsbench.planners.registry import EXPERT
from tsbench.report.analyses.model import ALL
from tsbench.run.edition import editions
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


def is_of_study(contract: str) -> bool:
    """Is a contract that of Moscow's test split, the scenes that stand for the study's?"""
    tests = (edition for edition in editions() if "test" in edition.now())
    return any(contract in (edition.now()["test"], edition.kept("test")) for edition in tests)


def is_whole(p: PlannerSummary, panel: str, contract: str) -> bool:
    """Has a planner signed episodes of every type of a panel, on Moscow's test split?"""
    if not is_of_study(contract):
        return False
    driven = p.scores[SIGNED_ONES].types if SIGNED_ONES in p.scores else {}
    return all(kind.id in driven for kind in load_catalog().types if panel in (ALL, kind.group))


def scd_beside(p: PlannerSummary, panel: str, contract: str) -> float | None:
    """The published SCD (%) to stand beside a planner's own; None where its episodes are not a whole panel of these."""
    return published_scd(p.planner, panel) if is_whole(p, panel, contract) else None


def metric_beside(p: PlannerSummary, metric: str, contract: str) -> float | None:
    """The published figure of a conventional metric, likewise."""
    return published_metric(p.planner, metric) if is_whole(p, ALL, contract) else None


def published_scd(planner: str, panel: str) -> float | None:
    """The published SCD (%) of a group or of all types; None where there is none."""
    return published().get(planner, {}).get("scd_overall" if panel == ALL else f"scd_{panel}")


def published_metric(planner: str, metric: str) -> float | None:
    """The published figure of a conventional metric, None where there is none."""
    return published().get(planner, {}).get(metric)


def without_experts() -> tuple[str, ...]:
    """The study's nine planners that are told no rule, in the order of its table."""
    return tuple(name for name in published() if not name.endswith(EXPERT))


def in_published_order(planners: Iterable[str]) -> tuple[str, ...]:
    """Planners of the published table in its order, then the others by name."""
    rank = {name: k for k, name in enumerate(published())}
    return tuple(sorted(planners, key=lambda name: (rank.get(name, len(rank)), name)))
