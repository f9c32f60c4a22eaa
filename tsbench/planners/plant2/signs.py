"""What `plant2-ft` reads of signs: a token for each plate in sight, and the sign that holds now, remembered."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tsbench.planners.base import Observation, SignView
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.tokens import Pose
from tsbench.planners.plant2.vocabulary import Vocabulary
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.sim.world import EGO_LENGTH_M

_KMH_PER_MPS = 3.6
# A plate is read by those whom it faces.
_FACING_RAD = math.radians(60.0)
# A stop before the line, well within what the rule asks for: this near to the line with the front, and to the plate,
# which stands a little before it; this slow.
_LINE_M, _PLATE_M, STOPPED_MPS = 4.5, 6.0, 0.15


class SignMemory:
    """The sign that holds: the nearest plate on the way that faces the ego; once out of sight, the last one.

    A plate that ends a zone holds from where it is passed. Once the ego has stood before the line, what is left of a
    stop sign is to give way, and its state is that sign's: nothing else tells a planner that it may go on. So is that
    of a crossing with a secondary road that is announced to another arm of the junction ahead: the ego's is that road.
    """

    def __init__(self, network: RoadMap, vocabulary: Vocabulary) -> None:
        self.state = 0
        self._words = vocabulary
        self._stop, self._give_way = (
            vocabulary.state_of_word[word] for word in (vocabulary.stop, vocabulary.give_way)
        )
        self._network = network
        self._path: RoutePath | None = None
        self._edges: frozenset[str] = frozenset()
        self._stood: set[tuple[str, float]] = set()

    def update(self, o: Observation) -> int:
        if o.route.path is not self._path:
            self._path, self._edges = o.route.path, frozenset(o.route.path.edges)
        for sign in o.signs:
            if sign.code in self._words.secondary and self._other_arm(sign, o):
                self.state = self._give_way
                break
            if sign.edge not in self._edges or not faces(sign, o.ego.heading):
                continue
            if sign.code in self._words.ends and _ahead(sign, o) > 0.0:
                continue
            self.state = self._of(sign, o)
            break
        return self.state

    def _other_arm(self, sign: SignView, o: Observation) -> bool:
        """Does the plate's road lead to the junction that the ego's leads to, and is another one?"""
        edges, own = self._network.edges, self._network.lanes[o.route.path.lane_at(o.route.s)]
        other = None if own.internal or sign.edge in self._edges else edges.get(sign.edge)
        return other is not None and other.target == edges[own.edge].target

    def _of(self, sign: SignView, o: Observation) -> int:
        if sign.code != self._words.stop:
            return self._words.state_of(sign)
        place = sign.edge, sign.position_m
        if o.ego.speed <= STOPPED_MPS and _ahead(sign, o) <= _PLATE_M and _to_line(o) <= _LINE_M:
            self._stood.add(place)
        return self._give_way if place in self._stood else self._stop


def _ahead(sign: SignView, o: Observation) -> float:
    """Metres from the ego's centre on to where it is abeam of the plate."""
    ego = o.ego
    return (sign.x - ego.x) * math.cos(ego.heading) + (sign.y - ego.y) * math.sin(ego.heading)


def _to_line(o: Observation) -> float:
    """Metres from the ego's front to the end of the lane that the route is on."""
    s = o.route.s
    end = next((piece.s1 for piece in o.route.path.pieces if s <= piece.s1), s)
    return end - s - EGO_LENGTH_M / 2


def faces(sign: SignView, heading: float) -> bool:
    """Is the plate turned towards one who drives at this heading?"""
    return math.cos(sign.heading - heading) > math.cos(_FACING_RAD)


def fill_signs(
    record: at.Record, o: Observation, pose: Pose, lane_order: int, classes: Mapping[str, int]
) -> None:
    """Write `signs` and `sign_classes`, nearest first; anonymous and unknown plates leave no token.

    lane_order: of the ego's lane, to which a plate's own lane is related. classes: of codes (`Vocabulary.class_of`).
    """
    x0, y0, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    slot = 0
    for sign in o.signs:
        if sign.code not in classes or slot == at.SIGNS:
            continue
        dx, dy, turn = sign.x - x0, sign.y - y0, sign.heading - heading
        record["sign_classes"][slot] = classes[sign.code]
        record["signs"][slot] = (
            (c * dx + s * dy) / at.POSITION_SCALE_M, (c * dy - s * dx) / at.POSITION_SCALE_M,
            math.cos(turn), math.sin(turn),
            (sign.value or 0.0) / _KMH_PER_MPS / at.SPEED_SCALE_MPS,
            0.0 if sign.lane < 0 else 1.0 + sign.lane - lane_order,
        )  # fmt: skip
        slot += 1
