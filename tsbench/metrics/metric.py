"""What a metric of an episode is: its column, measurement and summary; and SCD, the primary one.

SCD is sign-compliant and arrived. Of an episode it is yes or no (`is_scd`): `Verdicts.against` of
`tsbench.rules.monitor` collects what counts against it, events of the targets' rules, needless obedience in a contrast
half, and the wrong way. An episode with an error outcome has it not.

A figure of SCD is a share of one part of the records (`Records.of`): of the signed halves (and what has no pair), of
the contrast halves, or of the pairs. A pair passed where both halves did: paired SCD, the primary figure. Over several
types it is the mean of the types' shares (`tsbench.metrics.breakdown`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.geometry.polyline import Array
from tsbench.metrics.tracks import Tracks, tracks_of
from tsbench.scenarios.spec import CONTRAST, SIGNED

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


def is_scd(facts: EpisodeFacts) -> bool:
    """SCD of an episode: arrived, the targets' rules kept, nothing obeyed needlessly, and never the wrong way."""
    return facts.outcome is Outcome.ARRIVED and not facts.verdicts.against


def scd_of_both(one: Array, other: Array) -> Array:
    """(n,) SCD of pairs from that of their halves, of squares from that of their pairs; NaN where either has none."""
    return np.minimum(one, other)


SCD = Metric(
    "scd",
    bool,
    lambda e: is_scd(e.facts),
    "compliant and arrived, never the wrong way, and in a contrast scene nothing obeyed needlessly: the primary "
    "metric; false for an error outcome",
    unit="%",
    scale=100.0,
    failure=0.0,
    about_rule=True,
)
# The figures of SCD by their names in summaries, the primary one first: share of pairs with both halves passed, of
# signed halves (and what has no pair), of contrast halves.
PAIRED, SIGNED_ONES, CONTRASTED = "paired_scd", "signed_scd", "contrast_scd"
PARTS = (PAIRED, SIGNED_ONES, CONTRASTED)
# Of scenarios with two signs, share of squares with all four rows passed: the primary one there.
SQUARED = "squared_scd"
EVERY_PART = (SQUARED, *PARTS)
# The half whose episodes a figure is over, where it is not both.
HALF_OF = {SIGNED_ONES: SIGNED, CONTRASTED: CONTRAST}
# The figures of SCD as tables call them.
NAMES = {SQUARED: "squared SCD", PAIRED: "paired SCD", SIGNED_ONES: "signed SCD", CONTRASTED: "contrast SCD"}
SCD_NOTE = (
    "SCD: sign-compliant and arrived, %, macro mean over types. Paired: both halves passed; signed, "
    "contrast: each half by itself, by the pair's type; signed SCD also counts scenes without a pair"
)
