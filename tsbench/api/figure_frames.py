"""Figures as pandas tables, one row for each figure and reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from tsbench.core.errors import load
from tsbench.metrics.aggregate import Summary
from tsbench.metrics.breakdown import Scores, StrictAndCompleted
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.intervals import Estimate
from tsbench.metrics.paired_differences import Comparison, Difference
from tsbench.scenarios.spec import pair_type

if TYPE_CHECKING:
    import pandas as pd

_ALL, _SCD_UNIT = "all", "%"
_Row = dict[str, Any]


def frame_of(table: pa.Table) -> pd.DataFrame:
    """An Arrow table. Raises InputError where pandas is missing."""
    load("pandas")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def episodes_frame(table: pa.Table) -> pd.DataFrame:
    """Episode records, with the type of each row's pair beside its own."""
    frame = frame_of(table)
    kinds = [pair_type(*row) for row in zip(frame["pair_id"], frame["scenario_type"], strict=True)]
    frame.insert(list(frame.columns).index("scenario_type") + 1, "pair_type", kinds)
    return frame


def summary_frame(summary: Summary) -> pd.DataFrame:
    """Every figure of every planner."""
    rows = [{"planner": p.planner, **row} for p in summary.planners for row in _rows(p.scores, p.metrics)]
    load("pandas")
    frame: pd.DataFrame = load("tsbench.api.figures").Figures(rows)
    return frame


def comparison_frame(comparison: Comparison) -> pd.DataFrame:
    """Every figure of A and of B, and B - A."""
    return _frame(list(_rows(comparison.scores, comparison.metrics)))


def flips_frame(comparison: Comparison) -> pd.DataFrame:
    """The scenarios that one of the two has as SCD and the other has not."""
    return _frame([asdict(flip) for flip in comparison.flips])


def _frame(rows: list[_Row]) -> pd.DataFrame:
    frame: pd.DataFrame = load("pandas").DataFrame(rows)
    return frame


def _rows(
    scores: Mapping[str, Scores[Estimate]] | Mapping[str, Scores[Difference]],
    metrics: Mapping[str, StrictAndCompleted[Estimate]] | Mapping[str, StrictAndCompleted[Difference]],
) -> Iterator[_Row]:
    """figure: of SCD, or a metric; over: all, group or type, and its name; reading: strict or completed."""
    for figure, found in scores.items():
        yield from _readings(found.overall, figure, _ALL, _ALL, _SCD_UNIT)
        for over, parts in (("group", found.groups), ("type", found.types)):
            for name, part in parts.items():
                yield from _readings(part, figure, over, name, _SCD_UNIT)
    for metric, value in metrics.items():
        yield from _readings(value, metric, _ALL, _ALL, METRICS[metric].unit)


def _readings(
    figure: StrictAndCompleted[Estimate] | StrictAndCompleted[Difference], name: str, over: str, part: str, unit: str
) -> Iterator[_Row]:
    for reading, value in figure.readings():
        yield {"figure": name, "over": over, "name": part, "reading": reading, "unit": unit, **asdict(value)}
