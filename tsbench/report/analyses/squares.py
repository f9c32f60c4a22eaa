"""Scenarios with two signs: squared SCD, how many rows of a square are passed, and which sign's rule is broken."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.metrics.breakdown import STRICT
from tsbench.metrics.scd import NAMES, SQUARED
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.columns import INTERVAL_NOTE, pick, text_columns
from tsbench.report.analyses.run_pool import RunPool, read_pool
from tsbench.scenarios.spec import square_of
from tsbench.signs.catalog import Catalog
from tsbench.signs.model import ScenarioType

_ROWS = 4
_FIRST, _LAST = "first", "last"
_NOTES = (
    f"squared SCD: all four rows of a square passed, %, with {INTERVAL_NOTE}; strict. n: squares",
    "rows passed: of four, mean. first, last: rows with an event of that sign's rule or needless obedience of it. Rows "
    "may have events of both; other failed rows did not arrive, or drove the wrong way",
)


def squares(paths: Sequence[Path], allow_partial: bool) -> Analysis:
    """The analysis of runs over scenarios with two signs. Raises InputError where there are none."""
    pool = read_pool(paths, allow_partial)
    catalog = pool.runs[0].data.catalog
    broken = _broken(pool, catalog)
    rows = [row for kind in catalog.combined for row in _rows(pool, kind, broken)]
    if not rows:
        raise InputError(f"{paths[0]}: has no whole square (tsbench run --split two-signs drives them)")
    columns = (
        *text_columns("type", "planner"),
        Column("n", "n", Kind.COUNT),
        Column(SQUARED, f"{NAMES[SQUARED]}\n%"),
        Column("rows", "rows\npassed", decimals=2),
        Column(_FIRST, "first sign\nbroken, % of rows"),
        Column(_LAST, "last sign\nbroken, % of rows"),
    )
    return Analysis("squares", pool.title("Two signs at once"), pool.contract, Table(columns, tuple(rows), 2), _NOTES)


def _rows(pool: RunPool, kind: ScenarioType, broken: dict[tuple[str, str], set[str]]) -> Iterator[Row]:
    starts = True
    for p in pool.summaries:
        if SQUARED not in p.scores or kind.id not in p.scores[SQUARED].types:
            continue
        table = pool.home[p.planner].of(p.planner).select(["scenario_id", "scenario_type", "pair_id", "scd"])
        found: dict[str, list[tuple[str, bool]]] = defaultdict(list)
        for row in table.to_pylist():
            if row["scenario_type"] == kind.id:
                found[square_of(row["pair_id"])].append((row["scenario_id"], row["scd"]))
        whole = [row for rows in found.values() if len(rows) == _ROWS for row in rows]
        shares = [
            Value(100.0 * sum(sign in broken[p.planner, name] for name, _ in whole) / len(whole))
            for sign in (_FIRST, _LAST)
        ]
        passed = Value(_ROWS * sum(scd for _, scd in whole) / len(whole))
        score = Value.of(pick(p.scores[SQUARED].types[kind.id], STRICT))
        yield Row((kind.id, pool.label(p.planner), len(whole) // _ROWS, score, passed, *shares), starts=starts)
        starts = False


def _broken(pool: RunPool, catalog: Catalog) -> dict[tuple[str, str], set[str]]:
    """By planner and scenario the signs with an event that counts."""
    first = {kind.id: set(catalog.type(kind.parts[0]).codes) for kind in catalog.combined}
    found: dict[tuple[str, str], set[str]] = defaultdict(set)
    for run in pool.runs:
        for event in run.violations.select(["planner", "scenario_id", "target", "rule", "sign_code"]).to_pylist():
            codes = first.get(event["scenario_id"].partition("-")[0])
            if codes is not None and event["target"] and event["rule"] != catalog.wrong_way.name:
                sign = _FIRST if event["sign_code"] in codes else _LAST
                found[event["planner"], event["scenario_id"]].add(sign)
    return found
