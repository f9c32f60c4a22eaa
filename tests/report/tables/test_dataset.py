"""The data set in two tables."""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.dataset.scenes.overview import TypeStats
from tsbench.report.tables.dataset import MAPS, ROWS, map_cells, row_cells, to_markdown

STOP = TypeStats(
    "stop", "test", 200, 20, 18, {"T": 12, "X": 8}, 0.5, 1.0, 0.9999, 1.0, 1.0, 0.0, 0.84,
)  # fmt: skip
REPORT = [
    {"type_id": "stop", "split": "test", "missed": {"X": 2}, "reasons": {"others | go first": 3}},
]


def test_a_share_is_whole_only_where_it_is() -> None:
    cells = dict(zip(ROWS, row_cells([STOP])[0], strict=True))
    assert cells["solvable"] == "100"
    assert cells["tempting"] == "99.9"
    assert cells["again"] == "0"
    assert cells["gap s"] == "0.8"


def test_no_gap_is_no_figure() -> None:
    assert row_cells([replace(STOP, gap_s=math.nan)])[0][-1] == ""


def test_quotas_and_reasons() -> None:
    cells = dict(zip(MAPS, map_cells([STOP], REPORT)[0], strict=True))
    assert cells["maps by stratum"] == "T 12, X 8"
    assert cells["quota missed"] == "X 2"
    assert cells["maps passed over, by reason"] == "3 others | go first"


def test_the_page_counts_rows_by_split() -> None:
    page = to_markdown([STOP, replace(STOP, split="train", rows=800)], REPORT)
    assert "1,000 rows (test 200, train 800)" in page
    assert "others &#124; go first" in page
    assert all(line.count("|") == len(MAPS) + 1 for line in page.splitlines()[-2:-1])
