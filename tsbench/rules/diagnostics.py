"""Rules without a sign, recorded beside the score. Source: spec/rules.md, "Verdict"."""

from __future__ import annotations

import math

from tsbench.maps.network import RoadNetwork
from tsbench.rules.base import Verdict, Violation, require_finite
from tsbench.sim.world import WorldSnapshot

# As far as the roundabout's wrong direction is tolerated (sign_catalog/rules/roundabout.yaml).
WRONG_WAY_M = 5.0
NAME = "wrong_way"


class WrongWay:
    """The centre moves more than 5 m in ordinary lanes that run more than 90 degrees off its heading."""

    def __init__(self, network: RoadNetwork) -> None:
        self._lanes = network.lanes
        self._start: WorldSnapshot | None = None
        self._last: WorldSnapshot | None = None
        self._run = 0.0
        self._ticks = 0
        self._steps = 0
        self._events: list[Violation] = []

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick. Raises ValueError for an ego that is nowhere."""
        require_finite(snapshot)
        ego = snapshot.ego
        lane = self._lanes[ego.lane] if ego.lane >= 0 else None
        if lane is None or lane.internal or math.cos(ego.heading - lane.line.heading_at(ego.s)) >= 0.0:
            self._close()
            return
        if self._last is None:
            self._start = snapshot
        else:
            before = self._last.ego
            self._run += math.hypot(ego.x - before.x, ego.y - before.y)
        self._last = snapshot
        self._ticks += 1

    def _close(self) -> None:
        start, last = self._start, self._last
        if start is not None and last is not None and self._run > WRONG_WAY_M:
            ego = start.ego
            self._steps += self._ticks
            self._events.append(
                Violation(
                    rule=NAME, clause=NAME, sign_id="", sign_code="", start_s=start.time, end_s=last.time,
                    x=ego.x, y=ego.y, heading=ego.heading, speed=ego.speed, value=self._run,
                    threshold=WRONG_WAY_M, margin=self._run - WRONG_WAY_M, unit="m", other=None,
                    sentence=f"From {start.time:.1f} s the ego drove {self._run:.1f} m against the "
                    f"direction of its lane (at most {WRONG_WAY_M:.1f} m).",
                )
            )  # fmt: skip
        self._start = self._last = None
        self._run, self._ticks = 0.0, 0

    def finish(self) -> Verdict:
        """Everybody is bound by this one."""
        self._close()
        return Verdict("", True, tuple(self._events), self._steps)
