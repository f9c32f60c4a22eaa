"""What several analyses have in common: readings of a figure, the order of groups, their heads."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.metrics.aggregate import Figure, PlannerSummary
from tsbench.metrics.intervals import Estimate
from tsbench.signs.model import GROUPS

STRICT, COMPLETED = "strict", "completed"


def readings(p: PlannerSummary) -> tuple[str, ...]:
    """Strict, and completed where that is less."""
    return (STRICT, COMPLETED) if p.completed < p.recorded else (STRICT,)


def pick(figure: Figure | None, reading: str) -> Estimate | None:
    """One reading of a figure. What has no value for a failure has one only: that of the completed episodes."""
    if figure is None:
        return None
    return figure.strict if reading == STRICT and figure.strict is not None else figure.completed


def present_groups(planners: Sequence[PlannerSummary]) -> tuple[str, ...]:
    """Groups that have episodes, in the catalogue's order."""
    return tuple(dict.fromkeys(g for _, g in present_types(planners)))


def present_types(planners: Sequence[PlannerSummary]) -> tuple[tuple[str, str], ...]:
    """(type, group) of all types that have episodes, by group and name."""
    found = {kind: group for p in planners for kind, group in p.type_groups.items()}
    rank = {group: k for k, group in enumerate(GROUPS)}
    return tuple(sorted(found.items(), key=lambda pair: (rank.get(pair[1], len(rank)), pair[1], pair[0])))
