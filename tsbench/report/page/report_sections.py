"""What a report shows of a pool of runs, as the template takes it. Every figure comes from the pool's summary."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from tsbench.metrics.paired_differences import compare, shared_scenarios
from tsbench.metrics.scd import HALF_OF, NAMES
from tsbench.report.analyses.analysis import ALL, Analysis, Cell, Column, Kind, Row, Table, Value, lines_of
from tsbench.report.analyses.columns import difference_columns, difference_rows, panels_of, text_columns
from tsbench.report.analyses.run_analyses import OF_POOL
from tsbench.report.analyses.run_pool import EpisodeIndex, RunPool
from tsbench.report.analyses.traffic_calibration import traffic
from tsbench.report.charts import inline_svg
from tsbench.report.page.page_format import pack_table, page_column
from tsbench.report.run_ending import citation, counted, failures_of, primary
from tsbench.report.wording import readable
from tsbench.scenarios.spec import pair_type

Section = dict[str, Any]
# What a narrow screen leaves out of a heat map.
_ROOM_FOR_SHARES = ("group", "figure")
_HALF_OF = {NAMES[part]: half for part, half in HALF_OF.items()}

# Of fewer planners a rank correlation says nothing that the table does not.
_FOR_CORRELATIONS = 6


def headlines(pool: RunPool) -> list[dict[str, str]]:
    """Each planner's primary figure, and how its episodes failed."""
    part, found = primary(pool.summaries), []
    failed = {run.path: failures_of(run) for run in pool.runs}
    for p in pool.summaries:
        run, figure = pool.home[p.planner], panels_of(p, part)[ALL].main
        shown = {"planner": p.label, "value": "–", "ends": "", "name": f"{NAMES[part]}, n = {figure.n:,}"}
        if figure.value is not None:
            shown["value"] = f"{figure.value:.1f} %"
        if figure.low is not None and figure.high is not None:
            shown["ends"] = f"95 %: {figure.low:.1f}–{figure.high:.1f}"
        shown["failed"] = counted(failed[run.path], run, p.planner).removeprefix(f"{p.planner}: ")
        found.append(shown)
    return found


def sections(pool: RunPool, index: EpisodeIndex) -> Iterator[Section]:
    def section(key: str, head: str, analysis: Analysis | None, **how: bool) -> Iterator[Section]:
        if analysis is not None:
            yield {"id": key, "head": head, **show(analysis, **how)}

    yield from section("summary", "Summary", OF_POOL["main"](pool))
    yield from section("intervals", "How sure", OF_POOL["intervals"](pool), fold=True)
    yield from section("types", "By type", OF_POOL["types"](pool), heat=True, figure=False)
    yield from section("planners", "Planners compared", comparison(pool))
    yield from section("failures", "Failures", OF_POOL["failures"](pool), fold=True)
    if len(pool.planners) >= _FOR_CORRELATIONS:
        yield from section("correlations", "What goes with SCD", OF_POOL["correlations"](pool), fold=True)
    yield from section("traffic", "Traffic against nuPlan", traffic(pool, index))


def show(analysis: Analysis, *, heat: bool = False, figure: bool = True, fold: bool = False) -> Section:
    """An analysis for the template. heat: colour shares; figure: with its chart; fold: hide the table at first."""
    table = analysis.table
    drawn = {
        name: inline_svg(draw, f"{analysis.name}-{name}", analysis.title)
        for name, draw in (("wide", analysis.draw), ("stacked", analysis.stacked))
        if draw is not None and figure
    }
    columns = [{**_column(c), "minor": heat and c.key in _ROOM_FOR_SHARES} for c in table.columns]
    counted = next((k for k, c in enumerate(table.columns) if c.key == "n"), None)
    rows = []
    for row in table.rows:
        n, pairs = None if counted is None else row.cells[counted], zip(table.columns, row.cells, strict=True)
        cells = [_cell(column, cell, heat, n) for column, cell in pairs]
        wanted = {"scenario_type": _text(table, row.cells, "type")}
        if half := _HALF_OF.get(_text(table, row.cells, "score")):
            wanted["half"] = half
        rows.append({"faint": row.faint, "starts": row.starts, "cells": cells, "wanted": wanted})
    notes = (*analysis.notes, *_without(table))
    shown = {"title": analysis.title, "columns": columns, "rows": rows, "notes": notes, "figures": drawn}
    return {**shown, "fold": fold, "heat": heat, "fixed": table.fixed}


def _column(column: Column) -> dict[str, Any]:
    head, *unit = column.head.split("\n")
    return {"head": head, "unit": " ".join(unit), "text": column.kind is Kind.TEXT, "key": column.key}


def _cell(column: Column, cell: Cell, heat: bool, n: Cell) -> dict[str, Any]:
    """n: what the row as a whole rests on; a figure that rests on fewer says so."""
    first, *below = lines_of(column, cell)
    number = column.kind is not Kind.TEXT
    shown: dict[str, Any] = {"text": first, "below": below, "number": number, "title": ""}
    if isinstance(cell, Value):
        counted = f"n = {cell.n:,}" if cell.n is not None else ""
        shown["title"] = ", ".join(part for part in (counted, cell.reason) if part)
        if isinstance(n, int) and cell.n is not None and cell.value is not None and cell.n != n:
            shown["below"] = [*below, counted]
        if heat and cell.value is not None:
            shown["heat"] = round(min(max(cell.value, 0.0), 100.0), 1)
    return shown


def _without(table: Table) -> tuple[str, ...]:
    """Why figures of a table stand without an interval, once for each reason."""
    found = {
        cell.reason
        for row in table.rows
        for cell in row.cells
        if isinstance(cell, Value) and cell.value is not None and cell.low is None and cell.reason
    }
    return (f"why some figures have no interval: {'; '.join(sorted(found))}",) if found else ()


def _text(table: Table, cells: Sequence[Cell], key: str) -> str:
    return next((str(cell) for column, cell in zip(table.columns, cells, strict=True) if column.key == key), "")


def about(pool: RunPool) -> list[dict[str, Any]]:
    told = []
    for run in pool.runs:
        m = run.manifest
        versions = ", ".join(f"{name} {v}" for name, v in (m.get("versions") or {}).items() if v)
        machine = m.get("machine") or {}
        git = m.get("git") or {}
        facts = {
            "folder": str(run.path),
            "planners": ", ".join(
                f"{p['name']}{' (privileged)' if p.get('privileged') else ''}" for p in m["planners"]
            ),
            "selection": pool.selection,
            "episodes": f"{len(run.episodes):,} of {sum(run.asked.values()):,} asked",
            "status": m["status"],
            "time": f"{m.get('started')} to {m.get('finished') or 'now'}",
            "edition": run.edition,
            "contract": run.contract,
            "rescored": run.rescored,
            "versions": versions,
            "commit": f"{git.get('commit') or 'unknown'}{', with changes' if git.get('modified') else ''}",
            "machine": f"{machine.get('processor')}, {machine.get('cores')} cores, {machine.get('memory_gib')} GiB",
        }
        told.append(facts)
    return told


_YES, _PASSED = {"yes": "good", "no": "bad"}, {"both": "good", "none": "bad"}
_OBEYED = "no violation of the sign's rule; – for an error outcome"
_COLUMNS = (
    page_column("planner", "planner", filter="choice"),
    page_column("scenario_type", "type", filter="choice", title="of a pair that of its signed half"),
    page_column("half", "half", filter="choice"),
    page_column("passes", "pair passed", filter="choice", marks=_PASSED, title="which halves of its pair were passed"),
    page_column("outcome", "outcome", filter="choice"),
    page_column("sign_compliant", "obeyed", "flag", filter="choice", marks=_YES, title=_OBEYED),
    page_column("scd", "SCD", "flag", filter="choice", marks=_YES, title="obeyed the sign and arrived"),
    page_column("told", "what happened", minor=True, wide=True),
    page_column("violation_clause", "clause", filter="choice"),
    page_column("measured", "measured", title="first violation: value / threshold"),
    page_column("violation_time_s", "at", "number", unit="s", minor=True),
    page_column("driving_score", "DS", "number", unit="%", minor=True),
    page_column("scenario_id", "scenario", filter="text"),
    page_column("map_id", "map", filter="text", minor=True),
    page_column("variant", "variant", "number", digits=0, minor=True),
    page_column("group", "group", filter="choice", minor=True),
    page_column("playable", "player", "flag", filter="choice", minor=True),
)


def episodes_table(index: EpisodeIndex, playable: Collection[int]) -> bytes:
    """Every episode as a row of `tsb.table`; playable: rows that a player has."""
    values: dict[str, list[Any]] = {c["name"]: list(index.columns.get(c["name"], ())) for c in _COLUMNS}
    stories = [index.stories.get(index.key(k)) for k in range(len(index))]
    values["measured"] = ["" if s is None else f"{s['value']:.4g} / {s['threshold']:.4g} {s['unit']}" for s in stories]
    values["told"] = [
        error or "" if s is None else readable(s["sentence"])
        for s, error in zip(stories, index.columns["error"], strict=True)
    ]
    values["violation_clause"] = [clause or "" for clause in values["violation_clause"]]
    values["scenario_type"] = list(map(pair_type, index.columns["pair_id"], index.columns["scenario_type"]))
    values["passes"] = [index.passes.get(k, "") for k in range(len(index))]
    values["playable"] = [k in playable for k in range(len(index))]
    for column in _COLUMNS:
        if column["kind"] == "number":
            digits = column.get("digits", 1)
            values[column["name"]] = [None if v is None else round(v, digits + 1) for v in values[column["name"]]]
    return pack_table(_COLUMNS, values)


def heading(pool: RunPool) -> dict[str, Any]:
    what = ", ".join(pool.planners) if len(pool.planners) <= 4 else f"{len(pool.planners)} planners"
    return {
        "title": pool.title(what),
        "partial": pool.summary.partial,
        "contract": pool.contract,
        "edition": pool.edition,
        "headlines": headlines(pool),
        "cited": [citation(run, [p for p in pool.summaries if pool.home[p.planner] is run]) for run in pool.runs],
    }


def comparison(pool: RunPool) -> Analysis | None:
    """Each planner minus the first: overall and by group. None where there is only one planner."""
    first, *others = pool.planners
    if not others:
        return None
    rows: list[Row] = []
    for other in others:
        a, b = shared_scenarios(*(pool.home[name].of(name) for name in (first, other)))
        found = compare(a, b, seed=pool.contract)
        starts = True
        for part, scores in found.scores.items():
            for panel, figure in scores.panels(ALL).items():
                rows += difference_rows((pool.label(other), NAMES[part], panel), figure, starts=starts)
                starts = False
    columns = (
        *text_columns("planner", "score", "types"),
        *difference_columns(f"{pool.label(first)}\n%", "planner\n%", "difference\npoints"),
    )
    notes = (
        f"SCD (strict) of each planner minus that of {first}, percentage points, over the n pairs or scenarios that "
        "both have; below the difference its 95 % interval (over places)",
        "lost, won: those that only the first, only the other one has; p: exact McNemar; MDE: where the "
        "difference is not significant, how large one would have been found (80 % power). By type, and each flipped "
        "scenario: tsbench compare",
    )
    title = pool.title(f"Compared with {first}")
    return Analysis("comparison", title, pool.contract, Table(columns, tuple(rows), 4), notes, data=pool.runs[0].data)
