"""Parts that several analyses share: readings of figures, differences as rows, the order of groups, published figures.

The study's table is published_results.csv; its figures stand beside the same planners on Moscow's test split.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import TypeVar

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import COMPLETED, STRICT, Counted, StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.paired_differences import Comparison, Difference
from tsbench.metrics.records import group_rank
from tsbench.metrics.scd import NAMES, PARTS, SIGNED_ONES
from tsbench.planners.planner_spec import EXPERT
from tsbench.report.analyses.analysis import ALL, Cell, Column, Kind, Row, Value
from tsbench.run.edition import editions
from tsbench.scenarios.data_set import DataSet

T = TypeVar("T", bound=Counted)
READINGS_NOTE = "strict: error outcomes count as failures; completed: without an error outcome (in either half)"
INTERVAL_NOTE = "95 % interval (shares: effective sample size over places; other means: cluster bootstrap over places)"


def readings(p: PlannerSummary) -> tuple[str, ...]:
    """Strict, and completed where that is less."""
    return (STRICT, COMPLETED) if p.completed < p.recorded else (STRICT,)


def pick(figure: StrictAndCompleted[T] | None, reading: str) -> T | None:
    return None if figure is None else figure.read(reading)


def present_parts(found: Iterable[PlannerSummary | Comparison]) -> tuple[str, ...]:
    """The figures of SCD that there are, the primary one first."""
    there = {part for one in found for part in one.scores}
    return tuple(part for part in PARTS if part in there)


def scd_columns(parts: Iterable[str]) -> Iterator[Column]:
    return (Column(part, f"{NAMES[part]}\n%") for part in parts)


def panels_of(p: PlannerSummary, part: str) -> dict[str, StrictAndCompleted[Estimate]]:
    """A figure of SCD over all types and by group; empty where the planner has it not."""
    return p.scores[part].panels(ALL) if part in p.scores else {}


def present_panels(planners: Sequence[PlannerSummary]) -> tuple[str, ...]:
    """All types, then the groups that have episodes, in the catalogue's order."""
    return (ALL, *dict.fromkeys(group for _, group in present_types(planners)))


def present_types(planners: Sequence[PlannerSummary], part: str = "") -> tuple[tuple[str, str], ...]:
    """(type, group) of all types that have episodes (of one figure of SCD, "" = any), by group and name."""
    found = {
        kind: group
        for p in planners
        for name, scores in p.scores.items()
        if part in ("", name)
        for kind, group in scores.type_groups.items()
    }
    return tuple(sorted(found.items(), key=lambda pair: (group_rank(pair[1]), pair[0])))


def with_rings(places: str, kind: str, placed: bool) -> str:
    """A number of places with its word where it is an unusual one: those of roundabouts are rings."""
    return f"{places} rings" if placed and kind == "roundabout" else places


def text_columns(*names: str, **heads: str) -> tuple[Column, ...]:
    """Columns with their own names as heads, then those with other heads by name."""
    return tuple(Column(name, head, Kind.TEXT) for name, head in (*zip(names, names, strict=True), *heads.items()))


def count_columns(*names: str, **heads: str) -> tuple[Column, ...]:
    return tuple(replace(column, kind=Kind.COUNT) for column in text_columns(*names, **heads))


def number_columns(decimals: int = 1, **heads: str) -> tuple[Column, ...]:
    return tuple(Column(name, head, Kind.NUMBER, decimals) for name, head in heads.items())


def difference_columns(a: str, b: str, difference: str, decimals: int = 1) -> tuple[Column, ...]:
    """Columns below which `difference_rows` puts its cells. The arguments are heads."""
    return (
        *text_columns("figure"),
        *number_columns(decimals, a=a, b=b),
        Column("difference", difference, decimals=decimals, signed=True),
        Column("p", "p", Kind.P),
        *number_columns(decimals, mde="MDE"),
        *count_columns("lost", "won", "n"),
    )


def difference_rows(
    names: tuple[Cell, ...], figure: StrictAndCompleted[Difference], starts: bool = False
) -> Iterator[Row]:
    """A figure's rows. names: the cells before its own; starts: a new block begins."""
    for k, (reading, d) in enumerate(figure.readings()):
        p = d.p if d.p_holm is None else d.p_holm
        cells = (*names, reading, d.a, d.b, Value.difference(d), p, d.mde, d.lost, d.won, d.n)
        yield Row(cells, starts=starts and not k, faint=bool(k))


NOTE = (
    "published: figures of the reference's paper, from its own simulator and scenes, without intervals; its numbers of "
    "episodes are not published"
)


@cache
def published() -> Mapping[str, Mapping[str, float]]:
    """By planner, in the order of the table: every published figure (%) by its column."""
    text = files("tsbench.report.analyses").joinpath("published_results.csv").read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    return {row["planner"]: {key: float(cell) for key, cell in row.items() if key != "planner"} for row in rows}


def is_of_study(contract: str) -> bool:
    """Is a contract that of Moscow's test split, the scenes that stand for the study's?"""
    tests = (edition for edition in editions() if "test" in edition.now())
    return any(contract in (edition.now()["test"], edition.kept("test")) for edition in tests)


def is_whole(p: PlannerSummary, panel: str, contract: str) -> bool:
    """Has a planner signed episodes of every type of a panel, on Moscow's test split?"""
    if not is_of_study(contract):
        return False
    driven = p.scores[SIGNED_ONES].types if SIGNED_ONES in p.scores else {}
    return all(kind.id in driven for kind in DataSet().catalog.types if panel in (ALL, kind.group))


def scd_beside(p: PlannerSummary, panel: str, contract: str) -> float | None:
    """The published SCD (%) to stand beside a planner's own; None where its episodes are not a whole panel of these."""
    return published_scd(p.planner, panel) if is_whole(p, panel, contract) else None


def published_scd(planner: str, panel: str) -> float | None:
    """The published SCD (%) of a group or of all types; None if it is not published."""
    return published().get(planner, {}).get("scd_overall" if panel == ALL else f"scd_{panel}")


def published_metric(planner: str, metric: str) -> float | None:
    """The published figure of a conventional metric; None if it is not published."""
    return published().get(planner, {}).get(metric)


def without_experts() -> tuple[str, ...]:
    """The study's nine planners that are told no rule, in the order of its table."""
    return tuple(name for name in published() if not name.endswith(EXPERT))


def in_published_order(planners: Iterable[str]) -> tuple[str, ...]:
    """Planners of the published table in its order, then the others by name."""
    rank = {name: k for k, name in enumerate(published())}
    return tuple(sorted(planners, key=lambda name: (rank.get(name, len(rank)), name)))
