"""The data set in two tables: what stands in it by type and split, and which quotas and maps it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any

from tsbench.dataset.scenes.overview import TypeStats
from tsbench.report.analyses.markdown import markdown_row

ROWS = (
    "type", "split", "rows", "maps", "places", "tagged", "solvable", "tempting", "engaged", "sane", "again", "gap s",
)  # fmt: skip
MAPS = ("type", "split", "maps by stratum", "quota missed", "maps passed over, by reason")


def row_cells(stats: Sequence[TypeStats]) -> list[list[str]]:
    """Cells below ROWS. again: share of rows that a second process drove to the same bytes."""
    cells = []
    for t in stats:
        shares = [
            _percent(v) for v in (t.tagged_share, t.solvable, t.tempting, t.engaged, t.sane, t.reproduced)
        ]
        gap = "" if isnan(t.gap_s) else f"{t.gap_s:.1f}"
        cells.append([t.type_id, t.split, *(str(v) for v in (t.rows, t.maps, t.places)), *shares, gap])
    return cells


def map_cells(stats: Sequence[TypeStats], report: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Cells below MAPS. report: what the last build wrote down (overview.build_report)."""
    strata = {(t.type_id, t.split): t.strata for t in stats}
    cells = []
    for entry in report:
        key = (str(entry["type_id"]), str(entry["split"]))
        cells.append(
            [*key, _counts(strata.get(key, {})), _counts(entry["missed"]), _reasons(entry["reasons"])]
        )
    return cells


def to_markdown(stats: Sequence[TypeStats], report: Sequence[dict[str, Any]]) -> str:
    """The page docs/dataset.md."""
    rows = sum(t.rows for t in stats)
    by_split = ", ".join(
        f"{split} {sum(t.rows for t in stats if t.split == split):,}"
        for split in dict.fromkeys(t.split for t in stats)
    )
    return "\n".join(
        [
            "# The data set in figures",
            "",
            f"Made by `tsbench scenarios stats --markdown docs/dataset.md`: {rows:,} rows ({by_split}).",
            "",
            "Shares are of rows, in %, by their certificates ([scenarios.md](scenarios.md)). places: spots more",
            "than 300 m apart that hold all maps. tagged: maps from extracts with full tags. again: driven to",
            "the same bytes by a second process. gap s: median of |arrival gap| between the ego and whom it has to",
            "watch, where there is somebody.",
            "",
            *_markdown(ROWS, row_cells(stats)),
            "",
            "Quotas, and why maps were passed over while they were filled:",
            "",
            *_markdown(MAPS, map_cells(stats, report)),
            "",
        ]
    )  # fmt: skip


def _markdown(heads: Sequence[str], cells: Sequence[Sequence[str]]) -> list[str]:
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    return [*lines, *(markdown_row(row) for row in cells)]


def _percent(share: float) -> str:
    """Whole only where it is whole: 99.96 % is not 100 %."""
    return f"{100 * share:.0f}" if share in (0.0, 1.0) else f"{min(100 * share, 99.9):.1f}"


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{k} {v}" for k, v in counts.items()) or "none"


def _reasons(reasons: dict[str, int]) -> str:
    return "; ".join(f"{n} {why}" for why, n in reasons.items()) or "none"
