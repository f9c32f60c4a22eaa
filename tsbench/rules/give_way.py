"""Give way to the vehicles on arms with priority. Source: docs/rules.md, "Give way". Units: m, s."""

from __future__ import annotations

from tsbench.core.errors import InputError
from tsbench.roads.junction_paths import JunctionPath, junction_paths, path_zones
from tsbench.roads.priority import RULE_FOLLOWING, PriorityVehicles
from tsbench.rules.crossing import CrossingJudge
from tsbench.rules.monitor import Monitor, Verdict
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EgoState, WorldSnapshot


class GiveWay(Monitor):
    """Approach, line, passage; the passage is judged on the connection that the ego really took.

    Which one that is, is known once the ego has left the junction: until then the ticks are kept, and then
    judged in order, as if it had been known from the start.
    """

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        super().__init__(sign, rule, scene)
        self._network = scene.network
        params = sign.params_as(GiveWayParams)
        self.line = self.line_of(params.approach)
        self._paths = junction_paths(scene.network, (params.approach,))
        if not self._paths:
            raise InputError(f"{scene.net}: edge {params.approach!r} leads nowhere (sign {sign.id!r})")
        self._priority_paths = junction_paths(scene.network, params.main_in)
        self._zones = path_zones(self._paths, self._priority_paths, least_overlap=rule.thresholds["least_overlap_m"])
        self._priority_vehicles = PriorityVehicles(
            scene.network, self._priority_paths, RULE_FOLLOWING, self.lanes_with_priority()
        )
        self._engage = rule.thresholds["engage_distance_m"]
        self._reach = rule.thresholds["priority_distance_m"]
        self._armed = False
        self._bound = [False] * len(self._paths)
        self._ticks: list[WorldSnapshot] = []
        self._crossing: CrossingJudge | None = None

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick: on the approach, in the junction, or behind it."""
        if self._ticks:
            self._pass(snapshot)
            return
        lane = snapshot.ego.lane
        if lane in self.line.lanes:
            self._close()
            self._armed = True
        elif self._crossing is not None:
            self._crossing.update(snapshot)
            if self._crossing.done:
                self._close()
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
                self._note_priority_vehicles(snapshot)

    def lanes_with_priority(self) -> frozenset[int] | None:
        """Lanes on which vehicles have priority; None: on all that lead to their paths."""
        return None

    def near_line(self, snapshot: WorldSnapshot, to_go: float) -> None:
        """A tick with the front within the decision window; for rules that ask for more than giving way."""

    def at_line(self, snapshot: WorldSnapshot) -> None:
        """The tick at which the front has crossed the line; likewise."""

    def _note_priority_vehicles(self, snapshot: WorldSnapshot) -> None:
        """For each of the ego's paths: is a vehicle upstream of its zone with it, and near enough?"""
        for vehicle in self._priority_vehicles.find(snapshot.actors):
            for k, row in enumerate(self._zones):
                zone = row[vehicle.path]
                if zone is not None and 0.0 < zone.b_in - vehicle.s <= self._reach:
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
        fits = [k for k, p in enumerate(self._paths) if p.target.edge == exit_edge] or list(range(len(self._paths)))
        egos = [t.ego for t in self._ticks]
        taken = min(fits, key=lambda k: (_deviation(self._paths[k], egos), k))
        self.engaged = self.engaged or self._bound[taken]
        self._bound = [False] * len(self._paths)
        crossing = CrossingJudge(
            self._paths[taken], self._zones[taken], self._priority_paths, self._priority_vehicles, self.rule, self.log
        )
        for tick in self._ticks:
            crossing.update(tick)
        self._ticks, self._crossing = [], crossing
        if crossing.done:
            self._close()

    def _close(self) -> None:
        """The passage is over: enter its events."""
        if self._crossing is not None:
            self._crossing.close()
            self._crossing = None

    def finish(self) -> Verdict:
        """A passage that was not completed is judged on the path that fits it best."""
        if self._ticks:
            self._resolve("")
        self._close()
        self.engaged = self.engaged or any(self._bound)
        return super().finish()


def _deviation(path: JunctionPath, egos: list[EgoState]) -> int:
    """Mean distance of the ego's front from the path in cm, so that equals stay equal in every frame."""
    return round(100.0 * sum(abs(path.line.project(*e.front)[1]) for e in egos) / len(egos))
