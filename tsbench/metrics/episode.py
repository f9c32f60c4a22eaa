"""Every metric of one episode, computed once after it has ended. Definitions: docs/metrics.md."""

from __future__ import annotations

from dataclasses import dataclass

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.metrics.comfort import comfort
from tsbench.metrics.flags import hard_braking, max_overspeed, stuck, wrong_way
from tsbench.metrics.interaction import efficiency, min_pet, min_ttc
from tsbench.metrics.progress import driving_score, route_completion
from tsbench.metrics.tracks import tracks_of
from tsbench.sim.world import DT_S


@dataclass(frozen=True, slots=True)
class EpisodeMetrics:
    """The metric columns of a record. None: does not apply to this episode (never a made-up zero).

    route_completion, driving_score, efficiency: %; comfort: share 0-1; mean_speed, max_overspeed: m/s;
    duration_s, min_ttc, min_pet: s; violations, violating_steps: of the target sign; all_violations: events
    of all signs; violation_*: the target's first event, value and threshold in the unit of its clause.
    """

    sign_compliant: bool
    sign_engaged: bool
    destination: bool
    scd: bool
    route_completion: float
    driving_score: float
    efficiency: float | None
    collision: bool
    collision_partner: str | None
    at_fault: bool | None
    off_road: bool
    comfort: float | None
    mean_speed: float
    duration_s: float
    steps: int
    violations: int
    violation_clause: str | None
    violation_time_s: float | None
    violation_x: float | None
    violation_y: float | None
    violation_value: float | None
    violation_threshold: float | None
    min_ttc: float | None
    min_pet: float | None
    max_overspeed: float | None
    hard_braking: bool
    stuck: bool
    wrong_way: bool
    violating_steps: int
    all_violations: int


def episode_metrics(facts: EpisodeFacts) -> EpisodeMetrics:
    """All metrics of one episode. Raises ValueError for one without a tick."""
    if not facts.snapshots:
        raise ValueError("an episode without a tick has no metrics")
    tracks = tracks_of(facts.snapshots)
    target, contact, scene = facts.target, facts.contact, facts.scene
    destination, off_road = facts.outcome is Outcome.ARRIVED, facts.outcome is Outcome.OFF_ROAD
    events = len(target.violations) + sum(len(v.violations) for v in facts.others)
    completion = route_completion(facts, tracks)
    first = target.violations[0] if target.violations else None
    steps = facts.snapshots[-1].step
    return EpisodeMetrics(
        sign_compliant=target.compliant,
        sign_engaged=target.engaged,
        destination=destination,
        scd=target.compliant and destination,
        route_completion=completion,
        driving_score=driving_score(completion, contact is not None, off_road, events),
        efficiency=efficiency(tracks),
        collision=contact is not None,
        collision_partner=None if contact is None else contact.partner_kind,
        at_fault=None if contact is None else contact.at_fault,
        off_road=off_road,
        comfort=comfort(tracks),
        mean_speed=float(tracks.speed.mean()),
        duration_s=round(steps * DT_S, 6),
        steps=steps,
        violations=len(target.violations),
        violation_clause=None if first is None else first.clause,
        violation_time_s=None if first is None else first.start_s,
        violation_x=None if first is None else first.x,
        violation_y=None if first is None else first.y,
        violation_value=None if first is None else first.value,
        violation_threshold=None if first is None else first.threshold,
        min_ttc=min_ttc(tracks),
        min_pet=min_pet(tracks),
        max_overspeed=max_overspeed(tracks, scene),
        hard_braking=hard_braking(tracks),
        stuck=stuck(tracks, scene),
        wrong_way=wrong_way(tracks, scene),
        violating_steps=target.violating_steps,
        all_violations=events,
    )
