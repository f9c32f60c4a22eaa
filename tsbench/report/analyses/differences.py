"""Paired differences as columns and rows: each strict, and completed where that rests on fewer pairs."""

from __future__ import annotations

from collections.abc import Iterator

from tsbench.metrics.compare import PairedFigure
from tsbench.metrics.paired import Difference
from tsbench.report.analyses.columns import COMPLETED, STRICT
from tsbench.report.analyses.model import Cell, Column, Kind, Row, Value


def readings_of(figure: PairedFigure) -> Iterator[tuple[str, Difference]]:
    """The main reading, and the completed one where it is another."""
    yield STRICT, figure.main
    if figure.strict is not None and figure.strict.n != figure.completed.n:
        yield COMPLETED, figure.completed


def difference_columns(a: str, b: str, difference: str, decimals: int = 1) -> tuple[Column, ...]:
    """Columns below which `difference_rows` puts its cells. The arguments are heads."""
    return (
        Column("figure", "figure", Kind.TEXT), Column("a", a, Kind.NUMBER, decimals),
        Column("b", b, Kind.NUMBER, decimals), Column("difference", difference, decimals=decimals, signed=True),
        Column("p", "p", Kind.P), Column("mde", "MDE", Kind.NUMBER, decimals), Column("lost", "lost", Kind.COUNT),
        Column("won", "won", Kind.COUNT), Column("pairs", "pairs", Kind.COUNT),
    )  # fmt: skip


def difference_rows(names: tuple[Cell, ...], figure: PairedFigure, starts: bool = False) -> Iterator[Row]:
    """A figure's rows. names: the cells before its own; starts: a new block begins."""
    for k, (reading, d) in enumerate(readings_of(figure)):
        p = d.p if d.p_holm is None else d.p_holm
        cells = (*names, reading, d.a, d.b, Value.difference(d), p, d.mde, d.lost, d.won, d.n)
        yield Row(cells, starts=starts and not k, faint=bool(k))
