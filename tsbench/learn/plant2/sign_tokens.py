"""What `plant2-ft` reads of signs: a token for each plate in sight, and the plates that hold, remembered.

The memory is of what was seen and driven, no more: which plate, how far ago, and whether the ego has stood for it. What
follows from that is the network's.

The vocabulary is data of a network's weights, kept in the head of their file. A sign that is not in it is an unknown
plate to that network, so the catalogue may grow.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.tokens import Pose
from tsbench.planners.helpers import identified
from tsbench.planners.observation import Observation, SignView
from tsbench.planners.weights import load_metadata
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.road_map import RoadMap
from tsbench.signs.catalog import Catalog
from tsbench.sim.world import DT_S, EGO_LENGTH_M

READER = "plant2-ft"
_KEY = "vocabulary"
# What a masked plate says (`SignView.masked`).
_POST = ""
# Rules whose plates on other arms of a junction set the right of way there.
_RIGHT_OF_WAY = ("give_way", "stop")


@dataclass(frozen=True)
class Vocabulary:
    """Codes by the row of the network's tables; a plate's value is a number beside its code, not a word.

    Attributes
    ----------
        codes: each a class of sign tokens with a projection of its own.
        full_stop: plates before which one has to have stood.
        right_of_way: plates that concern the ego on other arms of the junction ahead, too.
        ends: plates that close a zone.
    """

    codes: tuple[str, ...]
    full_stop: tuple[str, ...]
    right_of_way: tuple[str, ...]
    ends: tuple[str, ...]

    @cached_property
    def class_of(self) -> Mapping[str, int]:
        """Of codes, from 1 on: 0 is no plate."""
        return {code: k + 1 for k, code in enumerate(self.codes)}

    def with_posts(self) -> Vocabulary:
        """This, and a class for masked plates, which then leave a token of their place: for weights of a floor."""
        return replace(self, codes=(*self.codes, _POST))

    def metadata(self) -> dict[str, str]:
        """As it stands in the head of a weights file."""
        return {_KEY: json.dumps(asdict(self))}


def vocabulary_of_catalog(catalog: Catalog) -> Vocabulary:
    """All signs there are: for weights that are yet to be learned."""
    rules = {code: sign.rule.name for code, sign in catalog.signs.items()}
    return Vocabulary(
        codes=tuple(rules),
        full_stop=tuple(code for code, rule in rules.items() if rule == "stop"),
        right_of_way=tuple(code for code, rule in rules.items() if rule in _RIGHT_OF_WAY),
        ends=tuple(code for code, sign in catalog.signs.items() if sign.is_end),
    )


def vocabulary_of(folder: Path | None = None, name: str = READER) -> Vocabulary:
    """The words of a network's weights below `folder` (None: tsbench's own); InputError where they have none."""
    found = load_metadata(name, folder).get(_KEY)
    try:
        if found is None:
            raise ValueError("none in the file's head")
        raw = json.loads(found)
        fields = ("codes", "full_stop", "right_of_way", "ends")
        return Vocabulary(*(tuple(raw[field]) for field in fields))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"weights {name!r}: no vocabulary of signs ({error}): train them again (tsbench train {READER})"
        ) from None


_KMH_PER_MPS = 3.6
# A plate is read by the drivers that it faces.
_FACING_RAD = math.radians(60.0)
# A stop before the line, well within what the rule asks for: this near to the line with the front, and to the plate,
# which stands a little before it; this slow.
_LINE_M, _PLATE_M, STOPPED_MPS = 4.5, 6.0, 0.15
# Farther away than this a plate is as far as that.
_FAR_M = 100.0


@dataclass(frozen=True, slots=True)
class _Held:
    """A plate and how far ahead it is, m; negative once it is passed."""

    sign: SignView
    ahead: float


class SignMemory:
    """The plates that hold: on the way, and on another arm of the junction ahead.

    On the way it is the nearest one that faces the ego; one that ends a zone holds from where it is passed. On another
    arm it is the nearest plate on right of way. Once out of sight the last one holds, and is left behind by what the
    ego drives.
    """

    def __init__(self, network: RoadMap, vocabulary: Vocabulary) -> None:
        self.own: _Held | None = None
        self.other: _Held | None = None
        self._words, self._network = vocabulary, network
        self._path: RoutePath | None = None
        self._edges: frozenset[str] = frozenset()
        self._stood: set[tuple[str, float]] = set()
        self._step = -1

    def update(self, o: Observation) -> None:
        """What holds at this tick; a second call at a tick changes nothing."""
        if o.route.path is not self._path:
            self._path, self._edges = o.route.path, frozenset(o.route.path.edges)
        driven = o.ego.speed * DT_S if o.step != self._step else 0.0
        self._step = o.step
        self.own = self._seen_ahead(o) or _left_behind(self.own, driven)
        self.other = self._on_other_arm(o) or _left_behind(self.other, driven)
        self._watch_stop(o)

    def fill(self, record: at.Record, o: Observation, lane_order: int) -> None:
        """Write `held` and `held_classes`. lane_order: of the ego's lane, to which a plate's own is related."""
        to_line = min(_to_line(o), _FAR_M) / at.POSITION_SCALE_M
        for slot, held in enumerate((self.own, self.other)):
            if held is None:
                continue
            sign = held.sign
            record["held_classes"][slot] = self._words.class_of[sign.code]
            record["held"][slot] = (
                *_value_and_lane(sign, lane_order),
                min(max(held.ahead, -_FAR_M), _FAR_M) / at.POSITION_SCALE_M,
                to_line,
                float((sign.edge, sign.position_m) in self._stood),
            )

    def _seen_ahead(self, o: Observation) -> _Held | None:
        for sign in map(identified, o.signs):
            if sign.edge not in self._edges or not faces(sign, o.ego.heading):
                continue
            if sign.code not in self._words.class_of or (sign.code in self._words.ends and _ahead(sign, o) > 0.0):
                continue
            return _Held(sign, _ahead(sign, o))
        return None

    def _on_other_arm(self, o: Observation) -> _Held | None:
        """The nearest plate of right of way on a road that leads to the junction that the ego's leads to."""
        edges, own = self._network.edges, self._network.lanes[o.route.path.lane_at(o.route.s)]
        if own.internal:
            return None
        for sign in map(identified, o.signs):
            if sign.code not in self._words.right_of_way or sign.edge in self._edges:
                continue
            other = edges.get(sign.edge)
            if other is not None and other.target == edges[own.edge].target:
                return _Held(sign, _ahead(sign, o))
        return None

    def _watch_stop(self, o: Observation) -> None:
        if self.own is None or self.own.sign.code not in self._words.full_stop:
            return
        if o.ego.speed <= STOPPED_MPS and self.own.ahead <= _PLATE_M and _to_line(o) <= _LINE_M:
            self._stood.add((self.own.sign.edge, self.own.sign.position_m))


def _left_behind(held: _Held | None, driven: float) -> _Held | None:
    return None if held is None else _Held(held.sign, held.ahead - driven)


def _value_and_lane(sign: SignView, lane_order: int) -> tuple[float, float]:
    value = (sign.value or 0.0) / _KMH_PER_MPS / at.SPEED_SCALE_MPS
    return value, 0.0 if sign.lane < 0 else 1.0 + sign.lane - lane_order


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
    """Is the plate turned towards a vehicle with this heading?"""
    return math.cos(sign.heading - heading) > math.cos(_FACING_RAD)


def fill_signs(record: at.Record, o: Observation, pose: Pose, lane_order: int, classes: Mapping[str, int]) -> None:
    """Write `signs` and `sign_classes`, nearest first; anonymous and unknown plates and most backs leave no token.

    lane_order: of the ego's lane, to which a plate's own lane is related. classes: of codes (`Vocabulary.class_of`).
    """
    x0, y0, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    slot = 0
    for sign in map(identified, o.signs):
        if sign.code not in classes or slot == at.SIGNS:
            continue
        dx, dy, turn = sign.x - x0, sign.y - y0, sign.heading - heading
        record["sign_classes"][slot] = classes[sign.code]
        ahead, left = (c * dx + s * dy) / at.POSITION_SCALE_M, (c * dy - s * dx) / at.POSITION_SCALE_M
        own = _value_and_lane(sign, lane_order)
        record["signs"][slot] = (ahead, left, math.cos(turn), math.sin(turn), *own)
        slot += 1
