"""What several analyses have in common: readings of figures, paired differences as rows, the order of groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import COMPLETED, STRICT, Counted, StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.paired import Difference
from tsbench.metrics.records import CONTRASTED, PAIRED, PARTS, SIGNED_ONES, group_rank
from tsbench.report.analyses.model import ALL, Cell, Column, Kind, Row, Value

T = TypeVar("T", bound=Counted)
# The figures of SCD as tables call them.
NAMES = {PAIRED: "paired SCD", SIGNED_ONES: "signed SCD", CONTRASTED: "contrast SCD"}
SCD_NOTE = (
    "SCD: sign-compliant and arrived, %, macro mean over types. Paired: pairs of which both halves are; signed, "
    "contrast: the halves each by itself, by the pair's type; signed SCD is also over what has no pair"
)
READINGS_NOTE = (
    "strict: error outcomes count as failures; completed: without an error outcome (in either half)"
)
INTERVAL_NOTE = (
    "95 % interval (shares: effective sample size over places; other means: cluster bootstrap over places)"
)


def readings(p: PlannerSummary) -> tuple[str, ...]:
    """Strict, and completed where that is less."""
    return (STRICT, COMPLETED) if p.completed < p.recorded else (STRICT,)


def pick(figure: StrictAndCompleted[T] | None, reading: str) -> T | None:
    return None if figure is None else figure.read(reading)


def present_parts(planners: Sequence[PlannerSummary]) -> tuple[str, ...]:
    """The figures of SCD that there are, the primary one first."""
    return tuple(part for part in PARTS if any(part in p.scores for p in planners))


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


def text_columns(*names: str) -> tuple[Column, ...]:
    return tuple(Column(name, name, Kind.TEXT) for name in names)


def difference_columns(a: str, b: str, difference: str, decimals: int = 1) -> tuple[Column, ...]:
    """Columns below which `difference_rows` puts its cells. The arguments are heads."""
    return (
        Column("figure", "figure", Kind.TEXT), Column("a", a, Kind.NUMBER, decimals),
        Column("b", b, Kind.NUMBER, decimals), Column("difference", difference, decimals=decimals, signed=True),
        Column("p", "p", Kind.P), Column("mde", "MDE", Kind.NUMBER, decimals), Column("lost", "lost", Kind.COUNT),
        Column("won", "won", Kind.COUNT), Column("n", "n", Kind.COUNT),
    )  # fmt: skip


def difference_rows(
    names: tuple[Cell, ...], figure: StrictAndCompleted[Difference], starts: bool = False
) -> Iterator[Row]:
    """A figure's rows. names: the cells before its own; starts: a new block begins."""
    for k, (reading, d) in enumerate(figure.readings()):
        p = d.p if d.p_holm is None else d.p_holm
        cells = (*names, reading, d.a, d.b, Value.difference(d), p, d.mde, d.lost, d.won, d.n)
        yield Row(cells, starts=starts and not k, faint=bool(k))
