"""The data set in tables: rows by type and split, and the quotas and maps behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Any

from tsbench.make.scenes.overview import TypeStats, shown_reason
from tsbench.report.analyses.analysis import Analysis, Row, Table
from tsbench.report.analyses.columns import count_columns, number_columns, text_columns

_SAME = ("solvable", "tempting", "engaged", "sane")
_SHARES = {"tagged": "tagged_share", **{name: name for name in _SAME}, "again": "reproduced"}


def dataset_tables(stats: Sequence[TypeStats], report: Sequence[Mapping[str, Any]]) -> tuple[Analysis, Analysis]:
    """Rows, and maps. report: what the last build wrote down (overview.build_report)."""
    splits = dict.fromkeys(t.split for t in stats)
    counts = {split: sum(t.rows for t in stats if t.split == split) for split in splits}
    by_split = ", ".join(f"{split} {count:,}" for split, count in counts.items())
    rows = []
    for t in stats:
        shares = (percent(getattr(t, name)) for name in _SHARES.values())
        gap, seen = None if isnan(t.gap_s) else t.gap_s, "" if isnan(t.seen) else percent(t.seen)
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


def percent(share: float) -> str:
    """Whole only where it is whole: 99.96 % is not 100 %."""
    return f"{100 * share:.0f}" if share in (0.0, 1.0) else f"{min(100 * share, 99.9):.1f}"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{k} {v}" for k, v in counts.items()) or "none"


def _reasons(reasons: Mapping[str, int]) -> str:
    return "; ".join(f"{n} {shown_reason(why)}" for why, n in reasons.items()) or "none"
