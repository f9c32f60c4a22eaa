"""Imperfect eyes: which plates a planner is told, as what and when. Source: docs/perception.md. Units: m, s, rad.

Every draw comes from the pair, where the post stands and the tick, never from the plate's code: both halves of a pair
have the same luck, in any order of episodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from tsbench.core.benchmark import SIGN_RANGE_M
from tsbench.core.seeds import seed_of
from tsbench.episode.perception_level import PerceptionLevel
from tsbench.geometry.elementary import log_of
from tsbench.planners.observation import SignView
from tsbench.roads.road_map import RoadMap
from tsbench.signs.catalog import Catalog
from tsbench.sim.world import DT_S, ActorKind, Box, EgoState, WorldSnapshot

T = TypeVar("T")

RIGHT, MISREAD, FALSE, POST, OUTLINE = "right", "misread", "false", "post", "outline"

_FOCAL_PX, _PLATE_M = 1266.0, 0.7
_HALF_FIELD = math.cos(math.radians(60.0))
_FACES = math.cos(math.radians(75.0))
# SUMO gives no heights: buses, and whatever of four wheels is longer than a car, are taken to be above 2 m.
_LONGEST_CAR_M = 5.5
# A false plate may come up in every stretch of so many metres driven, so far ahead and so far to the right.
_STRETCH_M, _FALSE_AHEAD_M, _FALSE_ASIDE_M = 10.0, 30.0, 4.0


@dataclass(frozen=True, slots=True)
class SignDetection:
    """From this tick on a planner is told a plate: as what, and how far ahead of the ego it then is.

    kind: RIGHT, MISREAD, FALSE, POST (in sight, not read), or OUTLINE (seen from behind). sign, role: of the plate that
    stands there, "" for a false one. x, y: where it is told to be. ahead_m: along the ego's heading. speed: the ego's.
    outline: as told, "" for a post.
    """

    step: int
    kind: str
    sign: str
    role: str
    code: str
    value: float | None
    x: float
    y: float
    ahead_m: float
    speed: float
    outline: str = ""


@dataclass(frozen=True, slots=True)
class Plate:
    """A plate as it stands: its id and role in the scene, and its view at no distance yet."""

    id: str
    role: str
    view: SignView


class _TrackedSign:
    """What becomes of one plate in one episode: the draws that it has for good, and how far it is."""

    def __init__(self, level: PerceptionLevel, pair: str, plate: Plate, catalog: Catalog) -> None:
        self.plate, self.seen, self.due, self.outline_due = plate, False, -1, -1
        self.shown: SignView | None = None
        self.name = (pair, f"{plate.view.x:.3f}", f"{plate.view.y:.3f}")
        latent, size, luck = (draw(word, *self.name) for word in ("latent", "size", "neighbour"))
        view = plate.view
        self.kind, self.told_as = MISREAD, view
        if latent < level.right:
            self.kind = RIGHT
        elif latent < level.told and (wrong := _neighbour(level, view, catalog, luck)):
            self.told_as = wrong
        else:
            self.kind = ""
        self.smallest_px = level.half_px + level.scale_px * log_of(size / (1.0 - size))
        shift = level.noise_m * (2.0 * draw("place", *self.name) - 1.0)
        self.told_as = replace(
            self.told_as,
            x=view.x + shift * math.cos(view.heading),
            y=view.y + shift * math.sin(view.heading),
            position_m=view.position_m + shift if view.edge else view.position_m,
        )
        self.behind = replace(self.told_as.from_behind(), outline=view.outline)


class SignDetector:
    """The eyes of one episode; asked once a tick, in order. pair: `ScenarioSpec.pair_name`."""

    def __init__(
        self, level: PerceptionLevel, pair: str, plates: Sequence[Plate], road_map: RoadMap, catalog: Catalog
    ) -> None:
        self._level, self._pair, self._map, self._catalog = level, pair, road_map, catalog
        self._watched = [_TrackedSign(level, pair, plate, catalog) for plate in plates]
        self._false: list[SignView] = []
        self._latency = round(level.latency_s / DT_S)
        self._sure = level.ceiling / level.told if level.told else 0.0
        self._driven, self._last = 0.0, (math.nan, math.nan)
        self.told: list[SignDetection] = []

    def look(self, snapshot: WorldSnapshot, seen: EgoState) -> list[SignView]:
        """What is known of plates at this tick, near or far, at no distance yet. seen: the ego on the map."""
        ego, step = snapshot.ego, snapshot.step
        high: list[Box] | None = None
        for one in self._watched:
            if one.due < 0 and in_field(ego, one.plate.view):
                high = _high_boxes(snapshot) if high is None else high
                if not hidden(ego, one.plate.view, high):
                    self._see(one, ego, step)
            if one.outline_due == step and not 0 <= one.due <= step:
                self._tell(one, OUTLINE, one.behind, ego, step)
            if one.due == step:
                self._tell(one, one.kind, one.told_as, ego, step)
        self._imagine(snapshot, seen)
        return [w.shown for w in self._watched if w.shown is not None] + self._false

    def _see(self, one: _TrackedSign, ego: EgoState, step: int) -> None:
        view = one.plate.view
        if faces(ego, view):
            if not one.seen:
                one.seen = True
                if self._level.posts and one.shown is None:
                    self._tell(one, POST, view.masked(), ego, step)
            if one.kind and self._reads(one, ego, step):
                one.due = step + self._latency
        elif one.kind and one.outline_due < 0 and _turned(ego, view) <= -_FACES and self._reads(one, ego, step):
            one.outline_due = step + self._latency

    def _reads(self, one: _TrackedSign, ego: EgoState, step: int) -> bool:
        view = one.plate.view
        px = _FOCAL_PX * _PLATE_M / max(math.hypot(view.x - ego.x, view.y - ego.y), 1.0)
        return px > one.smallest_px and draw("look", *one.name, step) < self._sure

    def _tell(self, one: _TrackedSign, kind: str, view: SignView, ego: EgoState, step: int) -> None:
        one.shown = view
        self._note(step, kind, one.plate.id, one.plate.role, view, ego)

    def _note(self, step: int, kind: str, sign: str, role: str, view: SignView, ego: EgoState) -> None:
        ahead = (view.x - ego.x) * math.cos(ego.heading) + (view.y - ego.y) * math.sin(ego.heading)
        told = SignDetection(
            step=step,
            kind=kind,
            sign=sign,
            role=role,
            code=view.code,
            value=view.value,
            x=view.x,
            y=view.y,
            ahead_m=ahead,
            speed=ego.speed,
            outline=view.outline,
        )
        self.told.append(told)

    def _imagine(self, snapshot: WorldSnapshot, seen: EgoState) -> None:
        """False plates, by the way that the ego has driven."""
        ego, before = snapshot.ego, int(self._driven / _STRETCH_M)
        if snapshot.step:
            self._driven += math.hypot(ego.x - self._last[0], ego.y - self._last[1])
        self._last = (ego.x, ego.y)
        chance = self._level.false_per_km * _STRETCH_M / 1000.0
        for stretch in range(before, int(self._driven / _STRETCH_M)):
            if draw("false", self._pair, stretch) < chance:
                view = self._false_plate(stretch, ego, seen)
                self._false.append(view)
                self._note(snapshot.step, FALSE, "", "", view, ego)

    def _false_plate(self, stretch: int, ego: EgoState, seen: EgoState) -> SignView:
        codes = sorted(sign.code for sign in self._catalog.signs.values() if not sign.is_end)
        sign = self._catalog.sign(_pick(codes, draw("false code", self._pair, stretch)))
        value = None
        if sign.value is not None:
            value = _pick(sign.value.allowed, draw("false value", self._pair, stretch))
        cos, sin = math.cos(ego.heading), math.sin(ego.heading)
        x = ego.x + _FALSE_AHEAD_M * cos + _FALSE_ASIDE_M * sin
        y = ego.y + _FALSE_AHEAD_M * sin - _FALSE_ASIDE_M * cos
        edge, position = "", math.nan
        if seen.lane >= 0 and not self._map.lanes[seen.lane].internal:
            lane = self._map.lanes[seen.lane]
            edge, position = lane.edge, min(seen.s + _FALSE_AHEAD_M, lane.line.length)
        return SignView(
            code=sign.code,
            value=value,
            x=x,
            y=y,
            heading=ego.heading,
            edge=edge,
            lane=-1,
            position_m=position,
            distance=math.inf,
            outline=sign.outline,
        )


def draw(*names: object) -> float:
    """A number between 0 and 1, both excluded, that belongs to these names."""
    return (seed_of("perception", *names) + 0.5) / 2.0**32


def in_field(ego: EgoState, plate: SignView) -> bool:
    """Whether the plate is in range and in the field of view."""
    dx, dy = plate.x - ego.x, plate.y - ego.y
    distance = math.hypot(dx, dy)
    if not 0.0 < distance <= SIGN_RANGE_M:
        return False
    return dx * math.cos(ego.heading) + dy * math.sin(ego.heading) >= _HALF_FIELD * distance


def hidden(ego: EgoState, plate: SignView, high: Sequence[Box]) -> bool:
    """Whether a high vehicle stands between the ego and the plate."""
    return any(_cuts(box, ego.x, ego.y, plate.x, plate.y) for box in high)


def faces(ego: EgoState, plate: SignView) -> bool:
    """In range, with its face turned to the ego, wherever that looks."""
    near = math.hypot(plate.x - ego.x, plate.y - ego.y) <= SIGN_RANGE_M
    return near and _turned(ego, plate) >= _FACES


def _turned(ego: EgoState, plate: SignView) -> float:
    """Cosine between the line of sight and the plate: 1 is its face, 0 its edge, -1 its back."""
    dx, dy = plate.x - ego.x, plate.y - ego.y
    return (dx * math.cos(plate.heading) + dy * math.sin(plate.heading)) / max(math.hypot(dx, dy), 1e-9)


def _high_boxes(snapshot: WorldSnapshot) -> list[Box]:
    actors = snapshot.actors
    high = (actors.kind == ActorKind.BUS) | ((actors.kind == ActorKind.CAR) & (actors.length > _LONGEST_CAR_M))
    return [actors.boxes[k] for k in np.flatnonzero(high).tolist()]


def _cuts(box: Box, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Does the segment from 0 to 1 meet the box? Clipped against its two pairs of sides."""
    x, y, heading, length, width = box
    cos, sin = math.cos(heading), math.sin(heading)
    enter, leave = 0.0, 1.0
    for ax, ay, half in ((cos, sin, length / 2), (-sin, cos, width / 2)):
        start, way = (x0 - x) * ax + (y0 - y) * ay, (x1 - x0) * ax + (y1 - y0) * ay
        if way == 0.0:
            if abs(start) > half:
                return False
            continue
        a, b = (-half - start) / way, (half - start) / way
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter <= leave


def _neighbour(level: PerceptionLevel, plate: SignView, catalog: Catalog, luck: float) -> SignView | None:
    """What this plate may be taken for; None where there is no such thing."""
    codes = _beside(level.codes, plate.code)
    if codes:
        code = _pick(codes, luck)
        return replace(plate, code=code, outline=catalog.sign(code).outline)
    posted = catalog.sign(plate.code).value if plate.value is not None else None
    if posted is None or plate.value is None or not posted.printed:
        return None
    values = [v for v in _beside(level.values, plate.value) if v in posted.allowed]
    return replace(plate, value=_pick(values, luck)) if values else None


def _beside(lines: Sequence[Sequence[T]], one: T) -> list[T]:
    """Those before and after `one` on the lines that it is on."""
    places = [(line, at) for line in lines for at, it in enumerate(line) if it == one]
    return [line[k] for line, at in places for k in (at - 1, at + 1) if 0 <= k < len(line)]


def _pick(things: Sequence[T], luck: float) -> T:
    return things[int(luck * len(things))]
