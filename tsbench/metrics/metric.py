"""What a metric of an episode is: its column and meaning, its measurement, and what a summary makes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.metrics.tracks import Tracks, tracks_of

Number = bool | int | float | str | None


def route_completion(facts: EpisodeFacts, tracks: Tracks) -> float:
    """Progress along the way driven to the destination, 0-100 %.

    The whole way is what was driven and what was left of the route at the end, so that an obedient detour
    counts as much as the shortest way. Where no route leads on, the way up to the place where the ego left
    its last route counts, as a share of the way at the start.
    """
    if facts.outcome is Outcome.ARRIVED:
        return 100.0
    route = facts.route
    if math.isinf(route.remaining):
        left = max(route.path.destination_s - route.s, 0.0)
        share = 1.0 - left / facts.start_remaining_m if facts.start_remaining_m > 0.0 else 0.0
    else:
        driven = float(np.hypot(np.diff(tracks.x), np.diff(tracks.y)).sum())
        whole = driven + route.remaining
        share = driven / whole if whole > 0.0 else 0.0
    return 100.0 * min(max(float(share), 0.0), 1.0)


class MetricInput:
    """An episode that has ended, with what several metrics share. Raises ValueError for one without a tick."""

    def __init__(self, facts: EpisodeFacts) -> None:
        if not facts.snapshots:
            raise ValueError("an episode without a tick has no metrics")
        self.facts, self.verdicts, self.contact, self.scene = facts, facts.verdicts, facts.contact, facts.scene
        self.tracks: Tracks = tracks_of(facts.snapshots)
        self.steps = facts.snapshots[-1].step
        self.arrived = facts.outcome is Outcome.ARRIVED
        self.off_road = facts.outcome is Outcome.OFF_ROAD
        self.events = sum(len(verdict.violations) for verdict in (*facts.verdicts.targets, *facts.verdicts.others))

    @cached_property
    def completion(self) -> float:
        return route_completion(self.facts, self.tracks)

    def first(self, field: str) -> Any:
        """A field of the first event that counts against SCD, None without one."""
        against = self.verdicts.against
        return getattr(against[0], field) if against else None


@dataclass(frozen=True, slots=True)
class Metric:
    """One figure of an episode; None where it does not apply, never a made-up zero.

    column, kind, meaning: of the records; of: measures it.
    name: in summaries, "" for what is in none. unit, scale: there, and the factor that leads to it. failure: what an
    error outcome counts as in the strict figure; None where it has no such value and only completed episodes count.
    head: short name in the main table, "" for what is not in it. about_rule: no conventional metric of driving.
    """

    column: str
    kind: type
    of: Callable[[MetricInput], Number]
    meaning: str
    name: str = ""
    unit: str = ""
    scale: float = 1.0
    failure: float | None = None
    head: str = ""
    about_rule: bool = False

    @property
    def binary(self) -> bool:
        return self.kind is bool
