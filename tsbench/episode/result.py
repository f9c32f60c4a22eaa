"""What running one episode gives back, before it becomes a record."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsbench.episode.command import Plan
from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.episode.perception import SignDetection
from tsbench.geometry.polyline import Array
from tsbench.scenarios.spec import ScenarioSpec


@dataclass(frozen=True)
class EpisodeResult:
    """One episode. `facts` is None if it ended before the first tick (a scene that does not load).

    error: one line, or ""; detail: traceback and SUMO's last words for `errors/`.
    planner_s: (n,) seconds that the planner took at each tick; sim_s, start_s, total_s: wall-clock seconds.
    commands: (n, 2) acceleration and steering as asked by the planner (or its trajectory's tracker).
    plans: where the planner meant to drive, with each command that told it.
    told: what it was told of plates, where its eyes were not exact.
    """

    spec: ScenarioSpec
    planner: str
    outcome: Outcome
    error: str
    detail: str
    facts: EpisodeFacts | None
    commands: Array
    planner_s: Array
    start_s: float
    sim_s: float
    total_s: float
    plans: tuple[Plan | None, ...] = field(default=(), kw_only=True)
    told: tuple[SignDetection, ...] = field(default=(), kw_only=True)
