"""A passage without a reason to wait: the last metres before a line, and what lies behind it. Units: m, s, m/s.

Source: docs/spec/contrast.md, "Needless obedience".
"""

from __future__ import annotations

import math

from tsbench.geometry.polyline import bend_speed
from tsbench.roads.blocking import PriorityGap, blockers
from tsbench.roads.junction_paths import junction_paths, path_zones
from tsbench.roads.priority import RULE_FOLLOWING, PriorityVehicles
from tsbench.rules.base import Monitor
from tsbench.rules.leaders import Leaders
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import PassageParams
from tsbench.sim.world import EGO_LENGTH_M, WorldSnapshot


class Passage:
    """Where the ego is on it, and who is a reason to wait.

    It ends half the way before its line again behind the line, so that who stands behind it has stood on it. through:
    has the ego come to its exit?
    """

    def __init__(self, monitor: Monitor, params: PassageParams) -> None:
        scene, self._t = monitor.scene, monitor.rule.thresholds
        self._road = monitor.road((params.approach, params.exit))
        self._line = self._road.starts[params.exit]
        self._approach_m = scene.network.edge_lanes(params.approach)[0].line.length
        self._begin = self._approach_m - self._t["before_line_m"]
        self._end = self._line + self._t["before_line_m"] / 2
        self._exit = frozenset(scene.network.edges[params.exit].lanes)
        network, give_way = scene.network, load_catalog().rule("give_way").thresholds
        paths = junction_paths(network, (params.approach,))
        self._paths = [p for p in paths if p.target.edge == params.exit]
        foes = junction_paths(network, params.main_in)
        self._zones = path_zones(self._paths, foes, least_overlap=give_way["least_overlap_m"])
        self._foes = PriorityVehicles(network, foes, RULE_FOLLOWING)
        self._gap = PriorityGap.of(give_way)
        self._leaders = Leaders(network)
        self.through = False

    def on_it(self, snapshot: WorldSnapshot) -> bool:
        """Is the ego's front on it?"""
        front = self._road.front(snapshot.ego)
        self.through = self.through or snapshot.ego.lane in self._exit
        return front is not None and self._begin <= front <= self._end

    def blocked(self, snapshot: WorldSnapshot) -> bool:
        """Does a vehicle with priority block the ego's way, or is somebody in it or about to step into it?"""
        ego = snapshot.ego
        front = self._road.front(ego)
        if front is None:
            return False
        vehicles = self._foes.find(snapshot.actors)
        return any(
            blockers(vehicles, row, front - self._approach_m, ego.speed, self._gap) for row in self._zones
        )

    def leader(self, snapshot: WorldSnapshot) -> float:
        """Speed of the slowest one near ahead; inf where nobody is."""
        reach = self._t["leader_gap_s"] * snapshot.ego.speed + EGO_LENGTH_M
        return min((v for _, v in self._leaders.within(snapshot, reach)), default=math.inf)

    def turn_speed(self, lateral: float) -> float:
        """At which a careful driver takes the junction, m/s; inf where its way does not bend."""
        return max((bend_speed(p.onto_exit(EGO_LENGTH_M), lateral) for p in self._paths), default=math.inf)
