"""Give way to the vehicles on arms with priority. Source: docs/spec/rules.md, "Give way". Units: m, s.

Plate params: `junction`; `approach`, the ego's edge into it; `main_in`, the edges into it that have priority.
"""

from __future__ import annotations

from typing import ClassVar

from tsbench.errors import InputError
from tsbench.rules.base import Monitor, Verdict
from tsbench.rules.crossing import Crossing
from tsbench.rules.events import EventLog
from tsbench.rules.foes import FoeFinder
from tsbench.rules.lines import ApproachLine
from tsbench.rules.paths import JunctionPath, junction_paths, zones
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EgoState, WorldSnapshot


class GiveWay(Monitor):
    """Approach, line, passage; the passage is judged on the connection that the ego really took.

    Which one that is, is known once the ego has left the junction: until then the ticks are kept, and then
    judged in order, as if it had been known from the start.
    """

    needs: ClassVar[tuple[str, ...]] = ("junction", "approach", "main_in")

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self.log = EventLog(sign, rule)
        self._network = scene.network
        approach = self.edges("approach")[0]
        self._check_junction(approach)
        self.line = ApproachLine(scene.network, approach)
        self._paths = junction_paths(scene.network, approach)
        if not self._paths:
            raise InputError(f"{scene.net}: edge {approach!r} leads nowhere (sign {sign.id!r})")
        self._foe_paths: tuple[JunctionPath, ...] = tuple(
            p for e in self.edges("main_in") for p in junction_paths(scene.network, e)
        )
        self._zones = zones(self._paths, self._foe_paths)
        self._foes = FoeFinder(scene.network, self._foe_paths)
        self._engage = rule.thresholds["engage_distance_m"]
        self._reach = rule.thresholds["priority_distance_m"]
        self.engaged = False
        self._armed = False
        self._bound = [False] * len(self._paths)
        self._ticks: list[WorldSnapshot] = []
        self._crossing: Crossing | None = None

    def _check_junction(self, approach: str) -> None:
        junction = self.param("junction")
        for edge in (approach, *self.edges("main_in")):
            if self._network.edges[edge].target != junction:
                raise InputError(
                    f"{self.scene.additional}: sign {self.sign.id!r}: edge {edge!r} does not lead to "
                    f"junction {junction!r}"
                )

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick: on the approach, in the junction, or behind it."""
        if self._ticks:
            self._pass(snapshot)
            return
        lane = snapshot.ego.lane
        if lane in self.line.lanes:
            self._crossing, self._armed = None, True
        elif self._crossing is not None:
            self._crossing.update(snapshot)
            if self._crossing.done:
                self._crossing = None
            return
        if self._armed:
            self._approach(snapshot)

    def _approach(self, snapshot: WorldSnapshot) -> None:
        ego = snapshot.ego
        to_go = self.line.to_go(ego)
        if to_go is None:
            if ego.lane >= 0 and self._network.lanes[ego.lane].internal:
                self._cross(snapshot)
            elif ego.lane >= 0 and ego.lane not in self.line.lanes:
                self._armed = False
        elif to_go < 0.0:
            self._cross(snapshot)
        elif to_go <= self._engage:
            self.near_line(snapshot, to_go)
            if not all(self._bound):
                self._note_foes(snapshot)

    def near_line(self, snapshot: WorldSnapshot, to_go: float) -> None:
        """A tick with the front within the decision window; for rules that ask for more than giving way."""

    def at_line(self, snapshot: WorldSnapshot) -> None:
        """The tick at which the front has crossed the line; likewise."""

    def _note_foes(self, snapshot: WorldSnapshot) -> None:
        """For each of the ego's paths: is a vehicle upstream of its zone with it, and near enough?"""
        for foe in self._foes.find(snapshot.actors):
            for k, row in enumerate(self._zones):
                zone = row[foe.path]
                if zone is not None and 0.0 < zone.b_in - foe.s <= self._reach:
                    self._bound[k] = True

    def _cross(self, snapshot: WorldSnapshot) -> None:
        self._armed = False
        self.at_line(snapshot)
        self._ticks.append(snapshot)

    def _pass(self, snapshot: WorldSnapshot) -> None:
        self._ticks.append(snapshot)
        ego = snapshot.ego
        if ego.lane < 0 or ego.lane in self.line.lanes:
            return
        lane = self._network.lanes[ego.lane]
        # Half a length from either end: a strip next to the junction that was only brushed does not count.
        if not lane.internal and min(ego.s, lane.line.length - ego.s) > EGO_LENGTH_M / 2:
            self._resolve(lane.edge)

    def _resolve(self, exit_edge: str) -> None:
        """Judge the ticks on the best fitting path to `exit_edge`; of all paths if none leads there."""
        fits = [k for k, p in enumerate(self._paths) if p.target == exit_edge] or list(
            range(len(self._paths))
        )
        egos = [t.ego for t in self._ticks]
        taken = min(fits, key=lambda k: (_deviation(self._paths[k], egos), k))
        self.engaged = self.engaged or self._bound[taken]
        self._bound = [False] * len(self._paths)
        crossing = Crossing(
            self._paths[taken], self._zones[taken], self._foe_paths, self._foes, self.rule, self.log
        )
        for tick in self._ticks:
            crossing.update(tick)
        self._ticks = []
        self._crossing = None if crossing.done else crossing
        if crossing.done:
            crossing.close()

    def finish(self) -> Verdict:
        """A passage that was not completed is judged on the path that fits it best."""
        if self._ticks:
            self._resolve("")
        if self._crossing is not None:
            self._crossing.close()
        return self.log.verdict(self.engaged or any(self._bound))


def _deviation(path: JunctionPath, egos: list[EgoState]) -> int:
    """Mean distance of the ego's front from the path in cm, so that equals stay equal in every frame."""
    return round(100.0 * sum(abs(path.line.project(*e.front)[1]) for e in egos) / len(egos))
