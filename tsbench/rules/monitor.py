"""What a monitor is, and what it says; the zone of a plate. Source: docs/rules.md, "Verdict"."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from tsbench.core.errors import InputError
from tsbench.rules.events import EventLog, Excursion, Verdict, Violation
from tsbench.rules.lines import ApproachLine, Road
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.plate_params import ZoneParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EgoState, WorldSnapshot

__all__ = ["Monitor", "Verdict", "Violation", "require_finite"]


class Monitor(ABC):
    """Watches one sign during one episode: one `update` a tick, in order, from step 0; then `finish` once.

    The same code scores online and from a stored trace. An exception inside is an episode error, never
    "compliant".
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        self.sign, self.rule, self.scene = sign, rule, scene
        self.log = EventLog(sign, rule)
        self.engaged = False
        self._excursions: list[Excursion] = []

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick. Raises ValueError for an ego that is nowhere: it can neither obey nor offend."""
        require_finite(snapshot)
        self.step(snapshot)

    @abstractmethod
    def step(self, snapshot: WorldSnapshot) -> None:
        """What the rule makes of one tick."""

    def finish(self) -> Verdict:
        """The verdict; excursions that are still open end with the episode."""
        for excursion in self._excursions:
            excursion.close()
        return self.log.verdict(self.engaged)

    def clauses(self) -> tuple[str, ...]:
        """Of each event so far its clause; excursions that are still open stand last."""
        return (*self.log.clauses(), *(e.clause for e in self._excursions if e.open))

    def excursion(self, clause: str, smaller_is_worse: bool = False) -> Excursion:
        """The excursions of one clause, one at a time."""
        self._excursions.append(Excursion(self.log, clause, smaller_is_worse))
        return self._excursions[-1]

    def road(self, edges: tuple[str, ...], order: int = 0) -> Road:
        """A stretch of road along which the ego is followed, as wide as the rule has it."""
        return Road(self.scene.network, edges, order, beside_widths=self.rule.thresholds["beside_road_widths"])

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


class Zone:
    """A stretch of road that a plate rules. start, end: m along `road`."""

    def __init__(self, monitor: Monitor) -> None:
        sign, scene = monitor.sign, monitor.scene
        edges = sign.params_as(ZoneParams).zone_edges
        where = f"{scene.additional}: sign {sign.id!r}"
        self.road = monitor.road(edges, sign.lane)
        self.start = sign.position_m
        self.end = self.road.length
        plate = _end_plate(sign, scene.signs)
        if plate is not None:
            if plate.edge not in self.road.starts:
                raise InputError(f"{where}: its end plate {plate.id!r} is not on an edge of its zone")
            self.end = self.road.starts[plate.edge] + plate.position_m
        if not self.start < self.end:
            raise InputError(f"{where}: its zone ends before it starts")

    def front(self, ego: EgoState) -> float | None:
        """Metres of the ego's front past the plate's line; None where it is outside the zone."""
        front = self.road.front(ego)
        return front - self.start if front is not None and self.start < front <= self.end else None


def _end_plate(sign: SignInstance, signs: tuple[SignInstance, ...]) -> SignInstance | None:
    return next((s for s in signs if s.ends == sign.id), None)
