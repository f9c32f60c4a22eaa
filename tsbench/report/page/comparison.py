"""The other planners of a report against its first one, scenario by scenario, as one table."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa
import pyarrow.compute as pc

from tsbench.metrics.compare import Comparison, PairedFigure, compare
from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.pool import Pool

ALL = "all types"


def comparison(pool: Pool) -> Analysis | None:
    """Each planner minus the first: overall and by group. None where there is only one planner."""
    first, *others = pool.planners
    if not others:
        return None
    rows: list[Row] = []
    for other in others:
        rows += _rows(other, _compare(pool, first, other))
    columns = (
        Column("planner", "planner", Kind.TEXT), Column("types", "types", Kind.TEXT), Column("a", f"{first}\n%"),
        Column("b", "planner\n%"), Column("difference", "difference\npoints"), Column("lost", "lost", Kind.COUNT),
        Column("won", "won", Kind.COUNT), Column("n", "pairs", Kind.COUNT), Column("p", "p\nMcNemar", Kind.P),
        Column("mde", "detectable\npoints", Kind.NUMBER),
    )  # fmt: skip
    notes = (
        f"SCD (strict) of each planner minus that of {first}, percentage points, over the scenarios that both have; "
        "below the difference its 95 % interval (paired cluster bootstrap over maps)",
        "lost, won: scenarios that only the first, only the other one has; p: exact McNemar; detectable: where the "
        "difference is not significant, how large one would have been found (80 % power). By type, and each flipped "
        "scenario: tsbench compare",
    )
    title = pool.title(f"Compared with {first}")
    return Analysis("comparison", title, pool.contract, Table(columns, tuple(rows), 2), notes)


def _compare(pool: Pool, first: str, other: str) -> Comparison:
    a, b = (pool.home[name].of(name) for name in (first, other))
    mine, theirs = ({str(name) for name in table["scenario_id"].to_pylist()} for table in (a, b))
    common = pa.array(sorted(mine & theirs))
    a, b = (table.filter(pc.is_in(table["scenario_id"], common)) for table in (a, b))
    return compare(a, b, seed=pool.contract)


def _rows(other: str, found: Comparison) -> Iterator[Row]:
    figures: dict[str, PairedFigure] = {ALL: found.overall, **found.groups}
    for name, figure in figures.items():
        d = figure.main
        cells = (
            other, name, Value(d.a), Value(d.b), Value(d.value, d.low, d.high, d.n, d.reason), d.lost, d.won, d.n, d.p,
            d.mde,
        )  # fmt: skip
        yield Row(cells, starts=name == ALL)
