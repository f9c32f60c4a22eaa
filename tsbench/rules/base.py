"""What a monitor is, and what it says. Source: docs/spec/rules.md, "Verdict"."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from tsbench.rules.lines import ApproachLine, Road
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot


@dataclass(frozen=True, slots=True)
class Violation:
    """One event: one excursion over a clause's threshold, edge-triggered.

    Times in s, pose in m and rad (ego centre, at the moment that decides), speed in m/s; `value`, `threshold`
    and `margin` (how far beyond the threshold, > 0) in `unit`; `other`: SUMO id of the other road user or
    obstacle. The moment that decides is the start of the excursion; `value` is the worst of the excursion.
    """

    rule: str
    clause: str
    sign_id: str
    sign_code: str
    start_s: float
    end_s: float
    x: float
    y: float
    heading: float
    speed: float
    value: float
    threshold: float
    margin: float
    unit: str
    other: str | None
    sentence: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Engaged at all? Which events? In how many ticks was a clause broken?"""

    sign_id: str
    engaged: bool
    violations: tuple[Violation, ...]
    violating_steps: int

    @property
    def compliant(self) -> bool:
        """No violation event of this sign's rule."""
        return not self.violations


class Monitor(ABC):
    """Watches one sign during one episode: one `update` a tick, in order, from step 0; then `finish` once.

    The same code scores online and from a stored trace. An exception inside is an episode error, never
    "compliant".
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        self.sign = sign
        self.rule = rule
        self.scene = scene

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick. Raises ValueError for an ego that is nowhere: it can neither obey nor offend."""
        require_finite(snapshot)
        self.step(snapshot)

    @abstractmethod
    def step(self, snapshot: WorldSnapshot) -> None:
        """What the rule makes of one tick."""

    @abstractmethod
    def finish(self) -> Verdict:
        """Close open excursions and give the verdict."""

    def road(self, edges: tuple[str, ...], order: int = 0) -> Road:
        """A stretch of road along which the ego is followed, as wide as the rule has it."""
        return Road(
            self.scene.network, edges, order, beside_widths=self.rule.thresholds["beside_road_widths"]
        )

    def line_of(self, approach: str) -> ApproachLine:
        """The line at the end of an approach, likewise."""
        return ApproachLine(self.scene.network, approach, self.rule.thresholds["beside_road_widths"])

    @property
    def completed(self) -> bool:
        """Has the ego done what this rule takes for reaching the destination? Most rules take nothing for it."""
        return False


def require_finite(snapshot: WorldSnapshot) -> None:
    """Raise ValueError where the ego's pose or speed is not finite."""
    ego = snapshot.ego
    if not math.isfinite(ego.x + ego.y + ego.heading + ego.speed):
        raise ValueError(f"step {snapshot.step}: the ego's state is not finite ({ego})")
