"""A figure in its two readings, and all figures of a report: overall, by group, by type, and of each metric.

Source: docs/metrics.md, "Aggregation". The same for one planner (means) and for two (differences).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.metrics.episode_metrics import METRICS
from tsbench.metrics.metric import Metric
from tsbench.metrics.records import Records
from tsbench.metrics.scd import EVERY_PART, SCD

STRICT, COMPLETED = "strict", "completed"

Mask = npt.NDArray[np.bool_]


class Counted(Protocol):
    """What a figure is read as. n: episodes or pairs that it rests on."""

    @property
    def n(self) -> int: ...


T = TypeVar("T", bound=Counted)
T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, slots=True)
class StrictAndCompleted(Generic[T]):
    """One figure in its two readings.

    strict: error outcomes count as failures; None for metrics without a value for a failure. completed: over what has
    no error outcome (of a difference, on neither side).
    """

    strict: T | None
    completed: T

    @property
    def main(self) -> T:
        return self.completed if self.strict is None else self.strict

    @property
    def differ(self) -> bool:
        return self.main.n != self.completed.n

    def read(self, reading: str) -> T:
        return self.main if reading == STRICT else self.completed

    def readings(self) -> Iterator[tuple[str, T]]:
        """The main reading, and the completed one where it is another."""
        yield STRICT, self.main
        if self.differ:
            yield COMPLETED, self.completed


@dataclass(frozen=True)
class Scores(Generic[T]):
    """One figure of SCD. overall, groups: macro means over types; types: of each; type_groups: their groups."""

    overall: StrictAndCompleted[T]
    groups: Mapping[str, StrictAndCompleted[T]]
    types: Mapping[str, StrictAndCompleted[T]]
    type_groups: Mapping[str, str]

    def panels(self, everything: str) -> dict[str, StrictAndCompleted[T]]:
        """The macro means: of all types, under the name `everything`, then of each group."""
        return {everything: self.overall, **self.groups}


class Breakdown(NamedTuple, Generic[T]):
    """scores: by figure of SCD, the primary one first, those alone that the records have; metrics: episode-weighted."""

    scores: Mapping[str, Scores[T]]
    metrics: Mapping[str, StrictAndCompleted[T]]


class Measure(Protocol[T_co]):
    """Measures one metric of `records` (those of the first side, for what all sides share).

    values: (n,) of each side; use: (n,) those that count; macro: mean over types, not episodes. label: names the
    bootstrap's draws.
    """

    def __call__(
        self, metric: Metric, label: str, records: Records, values: Sequence[Array], use: Mask, macro: bool
    ) -> T_co: ...


def twice(
    sides: Sequence[Records], measure: Measure[T], metric: Metric, label: str, use: Mask, macro: bool = False
) -> StrictAndCompleted[T]:
    """Both readings of one metric over a selection of the same scenarios on each side."""
    values = [side.values[metric.column] for side in sides]
    failed = np.logical_or.reduce([side.error for side in sides])
    known = ~np.logical_or.reduce([np.isnan(v) for v in values])
    completed = measure(metric, label, sides[0], values, use & ~failed & known, macro)
    if metric.failure is None:
        return StrictAndCompleted(None, completed)
    if not (use & failed).any():
        return StrictAndCompleted(completed, completed)
    whole = [np.where(side.error, metric.failure, v) for side, v in zip(sides, values, strict=True)]
    return StrictAndCompleted(measure(metric, label, sides[0], whole, use, macro), completed)


def break_down(sides: Sequence[Records], measure: Measure[T]) -> Breakdown[T]:
    """All figures of records of the same scenarios."""
    scores = {}
    for part in EVERY_PART:
        halves = [side.of(part) for side in sides]
        if len(halves[0]):
            scores[part] = _scores(halves, measure)
    everyone = np.ones(len(sides[0]), dtype=bool)
    metrics = {name: twice(sides, measure, metric, "overall", everyone) for name, metric in METRICS.items()}
    return Breakdown(scores, metrics)


def _scores(sides: Sequence[Records], measure: Measure[T]) -> Scores[T]:
    first = sides[0]
    panels = {
        panel: twice(sides, measure, SCD, panel_label(panel), use, macro=True) for panel, use in first.panels().items()
    }
    group_of = first.type_groups()
    types = {k: twice(sides, measure, SCD, f"type {k}", first.kind == first.kinds.index(k)) for k in group_of}
    return Scores(panels.pop(""), panels, types, group_of)


def panel_label(panel: str) -> str:
    """The bootstrap's label of a group, or of all ("")."""
    return f"group {panel}" if panel else "overall"
