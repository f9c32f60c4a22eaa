"""The other planners of a report against its first one, scenario by scenario, as one table."""

from __future__ import annotations

from collections.abc import Iterator

import pyarrow as pa
import pyarrow.compute as pc

from tsbench.metrics.compare import Comparison, compare
from tsbench.report.analyses.differences import difference_columns, difference_rows
from tsbench.report.analyses.model import Analysis, Column, Kind, Row, Table
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
        Column("planner", "planner", Kind.TEXT), Column("types", "types", Kind.TEXT),
        *difference_columns(f"{first}\n%", "planner\n%", "difference\npoints"),
    )  # fmt: skip
    notes = (
        f"SCD (strict) of each planner minus that of {first}, percentage points, over the scenarios that both have; "
        "below the difference its 95 % interval (paired cluster bootstrap over maps)",
        "lost, won: scenarios that only the first, only the other one has; p: exact McNemar; MDE: where the "
        "difference is not significant, how large one would have been found (80 % power). By type, and each flipped "
        "scenario: tsbench compare",
    )
    title = pool.title(f"Compared with {first}")
    return Analysis("comparison", title, pool.contract, Table(columns, tuple(rows), 3), notes)


def _compare(pool: Pool, first: str, other: str) -> Comparison:
    a, b = (pool.home[name].of(name) for name in (first, other))
    mine, theirs = ({str(name) for name in table["scenario_id"].to_pylist()} for table in (a, b))
    common = pa.array(sorted(mine & theirs))
    a, b = (table.filter(pc.is_in(table["scenario_id"], common)) for table in (a, b))
    return compare(a, b, seed=pool.contract)


def _rows(other: str, found: Comparison) -> Iterator[Row]:
    for name, figure in {ALL: found.overall, **found.groups}.items():
        yield from difference_rows((other, name), figure, starts=name == ALL)
