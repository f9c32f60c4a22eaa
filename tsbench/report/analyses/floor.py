"""How far planners are above those that read no plate: paired, signed and contrast SCD, overall, by group, by type.

Source: docs/spec/contrast.md, "What is reported".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from tsbench.metrics.aggregate import PlannerSummary
from tsbench.metrics.breakdown import STRICT, StrictAndCompleted
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.scd_records import PARTS
from tsbench.report.analyses.columns import (
    INTERVAL_NOTE,
    NAMES,
    SCD_NOTE,
    panels_of,
    pick,
    present_panels,
    present_types,
    text_columns,
    with_rings,
)
from tsbench.report.analyses.model import ALL, Analysis, Cell, Column, Kind, Row, Table, Value
from tsbench.report.analyses.pool import RunPool


def floor(pool: RunPool) -> Analysis:
    """A block of rows for all types, each group and each type; in it the planners, those that are floors last."""
    planners = sorted(pool.summaries, key=lambda p: p.floor)
    rows: list[Row] = []
    for panel in present_panels(planners):
        rows += _block(planners, "all" if panel == ALL else "group", panel)
    for kind, _ in present_types(planners):
        rows += _block(planners, "type", kind)
    columns = (
        *text_columns("over", "types", "planner"), *(Column(part, f"{NAMES[part]}\n%") for part in PARTS),
        Column("n", "n", Kind.COUNT), Column("places", "places", Kind.TEXT),
    )  # fmt: skip
    floors = ", ".join(p.planner for p in planners if p.floor)
    notes = (
        f"{SCD_NOTE}. Below each figure its {INTERVAL_NOTE}",
        "strict: error outcomes count as failures. n: pairs, or halves where there are none; places: theirs",
        f"floor: {floors} read no plate" if floors else "none of the planners is a floor",
    )
    title = pool.title("Planners and the sign-blind floor")
    return Analysis("floor", title, pool.contract, Table(columns, tuple(rows), 3), notes)


def _block(planners: list[PlannerSummary], over: str, name: str) -> Iterator[Row]:
    for k, p in enumerate(planners):
        found = [pick(_figures(p, part, over).get(name), STRICT) for part in PARTS]
        main = next((e for e in found if e is not None), None)
        cells: list[Cell] = [Value.of(e) for e in found]
        if main is not None:
            places = with_rings(str(main.clusters), name, p.placed)
            yield Row((over, name, p.label, *cells, main.n, places), starts=not k, faint=p.floor)


def _figures(p: PlannerSummary, part: str, over: str) -> Mapping[str, StrictAndCompleted[Estimate]]:
    if over == "type":
        return p.scores[part].types if part in p.scores else {}
    return panels_of(p, part)
