"""How far the ego came: route completion and driving score. Source: docs/spec/metrics.md, "Per episode"."""

from __future__ import annotations

import math

import numpy as np

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.metrics.tracks import Tracks

CONTACT_FACTOR = 0.5
OFF_ROAD_FACTOR = 0.7
VIOLATION_FACTOR = 0.9


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


def driving_score(completion: float, contact: bool, off_road: bool, violations: int) -> float:
    """0-100: completion x 0.5 (contact) x 0.7 (off road) x 0.9^n, n = violation events of all signs."""
    factor = CONTACT_FACTOR if contact else 1.0
    if off_road:
        factor *= OFF_ROAD_FACTOR
    return completion * factor * VIOLATION_FACTOR**violations
