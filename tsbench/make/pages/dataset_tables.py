"""The data set in tables: rows by type and split, in what they differ, tagging, and the quotas and maps behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isnan
from typing import Any

from tsbench.make.scenes.axes import TypeAxes
from tsbench.make.scenes.overview import TypeStats, shown_reason
from tsbench.make.scenes.tagging import GOAL, Tagging
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, to_markdown
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns

_SAME = ("solvable", "tempting", "engaged", "sane")
_SHARES = {"tagged": "tagged_share", **{name: name for name in _SAME}, "again": "reproduced"}
# The columns of the page's own table: as many as are as wide as a page.
_SHOWN = ("type", "rows", "pairs", "places", "tagged", "gap_s", "seen")


def dataset_tables(stats: Sequence[TypeStats], report: Sequence[Mapping[str, Any]]) -> tuple[Analysis, Analysis]:
    """Rows, and maps. report: what the last build wrote down (overview.build_report)."""
    splits = dict.fromkeys(t.split for t in stats)
    counts = {split: sum(t.rows for t in stats if t.split == split) for split in splits}
    by_split = ", ".join(f"{split} {count:,}" for split, count in counts.items())
    rows = []
    for t in stats:
        shares = (_percent(getattr(t, name)) for name in _SHARES.values())
        gap, seen = None if isnan(t.gap_s) else t.gap_s, "" if isnan(t.seen) else _percent(t.seen)
        rows.append(Row((t.type_id, t.split, t.rows, t.pairs, t.maps, t.places, *shares, gap, seen)))
    columns = (
        *text_columns("type", "split"),
        *count_columns("rows", "pairs", "maps", "places"),
        *text_columns(*_SHARES),
        *number_columns(gap_s="gap s"),
        *text_columns("seen"),
    )
    notes = (
        "Shares are of signed rows, in %, by their certificates. places: maps of the split within 300 m of each other, "
        "of one ring or one OSM way are one. "
        "tagged: maps from extracts with full tags. again: driven to the same bytes by a second process. gap s: median "
        "of |arrival gap| between the ego and the road users that it has to watch, where there are any. "
        "seen: pairs whose others "
        "betray the half before the ego is at its line, though too late to stop",
    )
    title = f"The data set: {sum(counts.values()):,} rows ({by_split})"
    strata = {(t.type_id, t.split): t.strata for t in stats}
    maps = tuple(
        Row(
            (
                kind,
                split,
                _counts(strata.get((kind, split), {})),
                _counts(e["missed"]),
                _reasons(e["reasons"]),
                _reasons(e.get("draws", {})),
            )
        )
        for e in report
        for kind, split in [(str(e["type_id"]), str(e["split"]))]
    )
    heads = text_columns(
        "type", "split", "maps by stratum", "quota missed", "maps passed over, by reason", "draws passed over"
    )
    quotas = "Quotas, and why maps were passed over while they were filled"
    return (
        Analysis("dataset-rows", title, "", Table(columns, tuple(rows), 2), notes),
        Analysis("dataset-maps", quotas, "", Table(heads, maps, 2), ()),
    )


def axes_table(axes: Sequence[TypeAxes]) -> Analysis:
    """In what a type's rows differ."""
    counts = {"plates": "plates and values", "speeds": "initial speeds", "densities": "densities"}
    means = {
        "distractors": "sets of distractors",
        "lanes": "start lanes",
        "destinations": "destinations",
        "approaches": "approaches",
        "lengths": "route lengths",
    }
    shares = {"apart": "apart", "apart_bare": "apart without distractors"}
    columns = (
        *text_columns("type", "split"),
        *count_columns(**counts),
        *(Column(key, head, Kind.NUMBER) for key, head in means.items()),
        *text_columns(*shares.values()),
    )
    rows = []
    for a in axes:
        numbers = (getattr(a, key) for key in (*counts, *means))
        rows.append(Row((a.type_id, a.split, *numbers, *(_percent(getattr(a, key)) for key in shares))))
    notes = (
        "Signed rows. Plates and values, initial speeds and densities: distinct ones in the type. The next five: "
        "distinct ones on a map, mean over maps. apart: % of rows that differ from every other row of their map in "
        "plate, value, distractors, start lane, approach or destination",
    )
    return Analysis("dataset-axes", "In what the rows of a map differ", "", Table(columns, tuple(rows), 2), notes)


def tagging_table(found: Sequence[Tagging]) -> Analysis:
    """Maps from the generalised extract, by type and split."""
    columns = (
        *text_columns("type", "split"),
        *count_columns("maps", "tagged", there="tagged in the pool"),
        *text_columns("generalised"),
    )
    rows = [Row((t.type_id, t.split, t.maps, t.tagged, t.there, _percent(t.share))) for t in found]
    return Analysis("dataset-tagging", "Tagging", "", Table(columns, tuple(rows), 2), (_tagging_note(found),))


def _tagging_note(found: Sequence[Tagging]) -> str:
    """Whether routing types keep the goal for generalised maps, split by split."""
    parts = []
    for split in dict.fromkeys(t.split for t in found if t.routing):
        of = [t for t in found if t.routing and t.split == split]
        over = [t for t in of if t.share > GOAL]
        share = _percent(sum(t.plain for t in of) / sum(t.maps for t in of))
        parts.append(f"{split}: {share} % generalised, {len(over)} of {len(of)} types above the goal")
    goal = f"At most {GOAL:.0%} of a routing type's test maps are to be from the generalised extract. "
    reason = (
        ". A build tries the tagged maps of a stratum first and takes a generalised one where no more of them pass. "
        "Most of those passed over have an obedient way that takes too long; the table of quotas counts the reasons"
    )
    return goal + "Routing types, " + "; ".join(parts) + reason if parts else ""


def dataset_page(tables: Sequence[Analysis], folder: str) -> str:
    """The page docs/dataset.md: the test split of the first table, and what stands in the files of all in `folder`."""
    head = "# The data set in figures\n\nMade by `tsbench scenarios stats --markdown docs/dataset.md`.\n"
    first, *others = tables
    keys = [column.key for column in first.table.columns]
    shown = [keys.index(key) for key in _SHOWN]
    rows = tuple(
        Row(tuple(row.cells[k] for k in shown)) for row in first.table.rows if row.cells[keys.index("split")] == "test"
    )
    test = Table(tuple(first.table.columns[k] for k in shown), rows, 1)
    parts = [head, to_markdown(replace(first, table=test))]
    parts.append(f"The table shows the test split. All splits and shares: {_link(first, folder)}.\n\n## More tables\n")
    for analysis in others:
        columns = ", ".join(column.head for column in analysis.table.columns)
        notes = "".join(f" {note.removesuffix('.')}." for note in analysis.notes if note)
        parts.append(f"* {_link(analysis, folder)}: **{analysis.title}.** Columns: {columns}.{notes}")
    return "\n".join(parts) + "\n"


def _link(analysis: Analysis, folder: str) -> str:
    return f"[`{folder}/{analysis.name}.csv`]({folder}/{analysis.name}.csv)"


def _percent(share: float) -> str:
    """Whole only where it is whole: 99.96 % is not 100 %."""
    return f"{100 * share:.0f}" if share in (0.0, 1.0) else f"{min(100 * share, 99.9):.1f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{k} {v}" for k, v in counts.items()) or "none"


def _reasons(reasons: Mapping[str, int]) -> str:
    return "; ".join(f"{n} {shown_reason(why)}" for why, n in reasons.items()) or "none"
