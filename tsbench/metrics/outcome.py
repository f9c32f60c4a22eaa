"""How an episode ends. Source: spec/metrics.md, "How an episode ends"."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tsbench.rules.base import Verdict
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


class Outcome(StrEnum):
    """Exactly one per episode; the last four are errors."""

    ARRIVED = "arrived"
    COLLISION = "collision"
    OFF_ROAD = "off_road"
    TIMEOUT = "timeout"
    PLANNER_ERROR = "planner_error"
    PLANNER_TIMEOUT = "planner_timeout"
    INVALID_OUTPUT = "invalid_output"
    SIM_ERROR = "sim_error"

    @property
    def is_error(self) -> bool:
        """Did the episode break off without a result?"""
        return self in (
            Outcome.PLANNER_ERROR,
            Outcome.PLANNER_TIMEOUT,
            Outcome.INVALID_OUTPUT,
            Outcome.SIM_ERROR,
        )


@dataclass(frozen=True, slots=True)
class Contact:
    """The contact that ended an episode. partner_kind: vehicle | pedestrian | obstacle; partner: SUMO id."""

    step: int
    partner_kind: str
    partner: str
    at_fault: bool


@dataclass(frozen=True)
class EpisodeFacts:
    """All that happened in one episode, the input of every per-episode metric.

    snapshots: one per tick, step 0 first. route: the navigation view at the last tick. target: verdict on the
    scenario's own sign; others: verdicts on the other signs. start_remaining_m: way to go at step 0.
    """

    scene: Scene
    snapshots: list[WorldSnapshot]
    route: RouteView
    start_remaining_m: float
    outcome: Outcome
    contact: Contact | None
    target: Verdict
    others: tuple[Verdict, ...]
