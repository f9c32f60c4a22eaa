"""Every metric of an episode, declared once: its column and meaning, its measurement, and what a summary makes of it.

The schema of the records, the summary, the tables and docs/metrics.md follow from `EPISODE_METRICS`. This file also
measures the driving score, and the flags that do not end an episode (stuck, hard braking, overspeed).
Source: docs/metrics.md. Units: m, s, m/s, rad.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from tsbench.episode.outcome import EpisodeFacts
from tsbench.metrics.comfort import LONGITUDINAL_MPS2, comfort
from tsbench.metrics.interaction import efficiency, min_pet, min_ttc
from tsbench.metrics.metric import Metric, MetricInput, Number
from tsbench.metrics.scd import SCD
from tsbench.metrics.tracks import Tracks
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EGO_LENGTH_M

CONTACT_FACTOR = 0.5
OFF_ROAD_FACTOR = 0.7
VIOLATION_FACTOR = 0.9


def driving_score(completion: float, contact: bool, off_road: bool, violations: int) -> float:
    """0-100: completion x 0.5 (contact) x 0.7 (off road) x 0.9^n, n = violation events of all signs."""
    factor = CONTACT_FACTOR if contact else 1.0
    if off_road:
        factor *= OFF_ROAD_FACTOR
    return completion * factor * VIOLATION_FACTOR**violations


STUCK_MPS = 0.1
STUCK_S = 20.0
REASON_AHEAD_M = 20.0
REASON_ASIDE_M = 2.0

_Mask = npt.NDArray[np.bool_]


def hard_braking(tracks: Tracks) -> bool:
    return bool((tracks.acceleration < LONGITUDINAL_MPS2[0]).any())


def max_overspeed(tracks: Tracks, scene: Scene) -> float | None:
    """Greatest speed above the limit of the ordinary lane that the ego was on, at least 0; None if on none.

    The limit is the one that planners are shown; what a plate posts is its rule's business.
    """
    network = scene.network
    shown = zip(network.lanes, network.shown_limits, strict=True)
    limit = np.array([np.nan if lane.internal else speed for lane, speed in shown] + [np.nan])
    over = tracks.speed - limit[tracks.lane]
    return None if np.isnan(over).all() else max(float(np.nanmax(over)), 0.0)


def stuck(tracks: Tracks, scene: Scene) -> bool:
    """Did the ego stand for more than 20 s without a reason ahead?

    A reason is another road user or an obstacle with its centre within 20 m ahead of the ego's front:
    straight ahead (2 m to either side) or within 45 degrees of its heading. One that comes by starts the
    count anew.
    """
    still = tracks.speed < STUCK_MPS
    if _longest(still) * DT_S <= STUCK_S:
        return False
    forward, left = tracks.in_ego_frame()
    reason = np.zeros(len(tracks), dtype=bool)
    reason[tracks.tick[_ahead(forward, left)]] = True
    c, s = np.cos(tracks.heading), np.sin(tracks.heading)
    for o in scene.obstacles:
        dx, dy = o.x - tracks.x, o.y - tracks.y
        reason |= _ahead(dx * c + dy * s, dy * c - dx * s)
    return _longest(still & ~reason) * DT_S > STUCK_S


def _ahead(forward: npt.NDArray[np.float64], left: npt.NDArray[np.float64]) -> _Mask:
    gap = forward - EGO_LENGTH_M / 2
    aside = np.abs(left)
    near: _Mask = (gap > 0.0) & (gap <= REASON_AHEAD_M) & ((aside <= gap) | (aside <= REASON_ASIDE_M))
    return near


def _longest(mask: _Mask) -> int:
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    runs = np.nonzero(edges < 0)[0] - np.nonzero(edges > 0)[0]
    return int(runs.max()) if len(runs) else 0


# In the order of the records' columns.
EPISODE_METRICS = (
    Metric(
        "sign_compliant", bool, lambda e: e.verdicts.compliant, "no violation event of the target signs' rules",
        "sign_compliance", "%", 100.0, 0.0, about_rule=True,
    ),
    Metric(
        "sign_engaged", bool, lambda e: e.verdicts.engaged,
        "the rule bound the ego at least once; if not, the episode counts neither as pass nor as failure of it",
        "engaged", "%", 100.0, head="engag.", about_rule=True,
    ),
    Metric(
        "destination", bool, lambda e: e.arrived, "the outcome is `arrived`",
        "destination", "%", 100.0, 0.0, head="dest.",
    ),
    SCD,
    Metric(
        "route_completion", float, lambda e: e.completion,
        "%: driven / (driven + what is left of the route at the end). The denominator is the way that was really "
        "taken, so an obedient detour counts like the shortest way. 100 on arrival. Where no route leads on, what it "
        "had completed of the way when it left its last route, as a share of the way at the start",
        "route_completion", "%", failure=0.0,
    ),
    Metric(
        "driving_score", float,
        lambda e: driving_score(e.completion, e.contact is not None, e.off_road, e.events),
        "route completion x 0.5 (contact) x 0.7 (off road) x 0.9^n, n = violation *events* of all signs in the scene",
        "driving_score", "%", failure=0.0, head="DS",
    ),
    Metric(
        "efficiency", float, lambda e: efficiency(e.tracks),
        "%, mean over steps of 100 x ego speed / mean speed of the vehicles within 50 m that move faster than 0.5 "
        "km/h. Pedestrians are no vehicles. Steps without such a vehicle are left out; null if that is all",
        "efficiency", "%", head="effic.",
    ),
    Metric(
        "collision", bool, lambda e: e.contact is not None, "a contact",
        "collision", "%", 100.0, head="coll.",
    ),
    Metric(
        "collision_partner", str, lambda e: None if e.contact is None else e.contact.partner_kind,
        "with `vehicle`, `pedestrian` or `obstacle`; null without a contact",
    ),
    Metric(
        "at_fault", bool, lambda e: None if e.contact is None else e.contact.at_fault,
        "whose fault (below); null without a contact",
    ),
    Metric(
        "off_road", bool, lambda e: e.off_road, "the outcome is `off_road`",
        "off_road", "%", 100.0, head="off road",
    ),
    Metric(
        "comfort", float, lambda e: comfort(e.tracks), "share of steps (0-1) within all of nuPlan's bounds (below)",
        "comfort", "%", 100.0, head="comf.",
    ),
    Metric(
        "mean_speed", float, lambda e: float(e.tracks.speed.mean()), "m/s, over ticks",
        "mean_speed", "m/s",
    ),
    Metric("duration_s", float, lambda e: round(e.steps * DT_S, 6), "s until the end"),
    Metric("steps", int, lambda e: e.steps, "steps until the end"),
    Metric("violations", int, lambda e: len(e.verdicts.violations), "events of the target sign"),
    Metric(
        "needless", int, lambda e: len(e.verdicts.needless),
        "events of needless obedience, in contrast scenes only; `violations` and `all_violations` do not count them",
    ),
    Metric(
        "violation_clause", str, lambda e: e.first("clause"),
        "the first event of the target sign, of needless obedience or of the wrong way: what was broken",
    ),
    Metric("violation_time_s", float, lambda e: e.first("start_s"), "its start"),
    Metric("violation_x", float, lambda e: e.first("x"), "where the ego was then, m"),
    Metric("violation_y", float, lambda e: e.first("y"), "where the ego was then, m"),
    Metric("violation_value", float, lambda e: e.first("value"), "what was measured, in the unit of its clause"),
    Metric("violation_threshold", float, lambda e: e.first("threshold"), "against what"),
    Metric(
        "violating_steps", int, lambda e: sum(verdict.violating_steps for verdict in e.verdicts.targets),
        "ticks in which a clause was broken; kept apart from events, never added",
    ),
    Metric("min_ttc", float, lambda e: min_ttc(e.tracks), "least time to collision, s (below)"),
    Metric("min_pet", float, lambda e: min_pet(e.tracks), "least post-encroachment time, s (below)"),
    Metric(
        "max_overspeed", float, lambda e: max_overspeed(e.tracks, e.scene),
        "m/s, greatest excess over the *road's* limit (the one that planners are shown, ordinary lanes only), at least "
        "0; what a plate posts is judged by its rule",
    ),
    Metric(
        "hard_braking", bool, lambda e: hard_braking(e.tracks), "the ego braked harder than 4.05 m/s2 at some tick",
    ),
    Metric(
        "stuck", bool, lambda e: stuck(e.tracks, e.scene),
        "it stood (< 0.1 m/s) for more than 20 s without a reason ahead. A reason is another road user or an obstacle "
        "whose centre is within 20 m ahead of the ego's front, straight ahead (2 m to either side) or within 45 "
        "degrees; while there is one, the count starts anew",
    ),
    Metric(
        "wrong_way", bool, lambda e: bool(e.verdicts.wrong_way),
        "for more than 3 m in all on ordinary lanes whose direction is against its heading (more than 90 degrees "
        "off), with no obstacle near: no pass, in either half",
    ),
    Metric("all_violations", int, lambda e: e.events, "events of all signs of the scene"),
)  # fmt: skip
# What summaries show beside SCD, by its name there: first what has a value for a failure, from the score down.
METRICS: Mapping[str, Metric] = {
    metric.name: metric
    for metric in (
        *(m for m in reversed(EPISODE_METRICS) if m.failure is not None),
        *(m for m in EPISODE_METRICS if m.failure is None),
    )
    if metric.name
}


def episode_metrics(facts: EpisodeFacts) -> dict[str, Number]:
    """The values of all metrics of an episode by their columns. Raises ValueError for one without a tick."""
    episode = MetricInput(facts)
    return {metric.column: metric.of(episode) for metric in EPISODE_METRICS}
