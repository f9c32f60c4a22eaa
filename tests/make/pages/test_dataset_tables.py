"""The data set in tables."""

from __future__ import annotations

import math
from dataclasses import replace

from tsbench.make.scenes.overview import TypeStats, dataset_tables
from tsbench.report.analyses.analysis import Analysis

STOP = TypeStats("stop", "test", 400, 200, 20, 18, {"T": 12, "X": 8}, 0.5, 1.0, 0.9999, 1.0, 1.0, 0.0, 0.84, 0.25)
REPORT = [
    {
        "type_id": "stop",
        "split": "test",
        "missed": {"X": 2},
        "reasons": {"others | go first": 3, "plate # stands # m along": 1},
        "draws": {"no": 4},
    }
]


def cells(analysis: Analysis) -> dict[str, object]:
    heads = [column.head for column in analysis.table.columns]
    return dict(zip(heads, analysis.table.rows[0].cells, strict=True))


def test_a_share_is_whole_only_where_it_is() -> None:
    rows = cells(dataset_tables([STOP], REPORT)[0])
    assert rows["solvable"] == "100"
    assert rows["tempting"] == "99.9"
    assert rows["again"] == "0"
    assert rows["gap s"] == 0.84


def test_where_there_is_nobody_and_no_pair_there_is_no_figure() -> None:
    rows = cells(dataset_tables([STOP], REPORT)[0])
    assert (rows["pairs"], rows["seen"]) == (200, "25.0")
    rows = cells(dataset_tables([replace(STOP, gap_s=math.nan, pairs=0, seen=math.nan)], REPORT)[0])
    assert (rows["gap s"], rows["seen"]) == (None, "")


def test_quotas_and_reasons() -> None:
    maps = cells(dataset_tables([STOP], REPORT)[1])
    assert maps["maps by stratum"] == "T 12, X 8"
    assert maps["quota missed"] == "X 2"
    assert maps["maps passed over, by reason"] == "3 others | go first; 1 plate … stands … m along"
    assert maps["draws passed over"] == "4 no"
