"""What an environment shows: each kind of observation with its space.

`objects` and `scene` are what a planner sees as tables of numbers, plates included, for networks that take sets.

Places are in the ego's frame (forward, left), angles as cosine and sine against its heading, rows sorted by distance.
`objects` is in m and m/s; a row that is not there is zero, its first number too. `scene` is for networks that shall
learn what a plate asks: every number lies in -1..1 (places over `FAR_M`), every table has a mask (1 = there), and
plates on the navigation's way stand before the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from tsbench.core.errors import InputError
from tsbench.learn.rl.actions import ways_to
from tsbench.learn.rl.carl_planner import RasterEncoder
from tsbench.learn.rl.ppo_planner import SIZE, VectorEncoder
from tsbench.learn.shared_inputs import CHANNELS, MEASUREMENTS, PIXELS
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation, SignView
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.model import OUTLINES
from tsbench.sim.ego import MAX_STEER_RAD
from tsbench.sim.world import ActorKind

# one_lane: 1 where it addresses one lane, and not all of its edge. lanes_left: by how many lanes that lane lies to the
# left of the ego's, counted from the kerb on, 0 without one. on_route: 1 where its edge is on the navigation's way.
ADDRESSED = ("one_lane", "lanes_left", "on_route")
# The two directions of the plate 8.13, against the approach's own; zeros where none hangs there.
MAIN_ROAD = ("main_cos_1", "main_sin_1", "main_cos_2", "main_sin_2")


class AddressedLanes:
    """Remembers the ego's lane through junctions, where lanes are not counted; make one per environment."""

    def reset(self, context: PlannerContext) -> None:
        """An episode begins."""
        self._graph = context.graph
        self._order = 0

    def __call__(self, o: Observation) -> npt.NDArray[np.float64]:
        """(plates, 3), a row per plate in sight, as `ADDRESSED`; a masked plate has zeros."""
        lane = o.ego.lane
        if lane >= 0 and not self._graph.network.lanes[lane].internal:
            self._order = self._graph.order_of(lane)
        way = o.route.path.edges
        rows = [
            (float(p.lane >= 0), float(p.lane - self._order) if p.lane >= 0 else 0.0, float(p.edge in way))
            for p in o.signs
        ]
        return np.array(rows).reshape(-1, len(ADDRESSED))


def main_road(plate: SignView) -> tuple[float, ...]:
    """As `MAIN_ROAD`."""
    if not plate.main_road:
        return (0.0,) * len(MAIN_ROAD)
    return tuple(part(angle) for angle in plate.main_road for part in (math.cos, math.sin))


Table = npt.NDArray[np.float32]

EGO = ("speed", "acceleration", "steering", "yaw_rate", "offset", "remaining", "limit")
ROUTE_COLUMNS = ("forward", "left")
ACTORS = ("there", "forward", "left", "cos", "sin", "speed", "length", "width", "kind")
OBSTACLES = ("there", "forward", "left", "cos", "sin", "length", "width")
SIGNS = ("there", "forward", "left", "cos", "sin", "code", "value", *ADDRESSED, "outline", *MAIN_ROAD)
OBJECT_ROWS = {"route": 20, "actors": 30, "obstacles": 8, "signs": 8}
_COLUMNS = {"route": ROUTE_COLUMNS, "actors": ACTORS, "obstacles": OBSTACLES, "signs": SIGNS}

_FAR_M = 1000.0
_REACH = 1.0e4


def sign_codes() -> list[str]:
    """The catalogue's signs, as columns and numbers of plates count them."""
    return sorted(DataSet().catalog.signs)


class ObjectsSeen:
    """A dictionary of tables. `code` counts the catalogue's signs from 1 in the order of their codes; 0 = not told.

    `outline` counts `OUTLINES` from 1; 0 = not told.
    """

    def __init__(self) -> None:
        self._codes = {code: k + 1 for k, code in enumerate(sign_codes())}
        self._outlines = {outline: k + 1 for k, outline in enumerate(OUTLINES)}
        self._addressed = AddressedLanes()
        shapes: dict[str, tuple[int, ...]] = {name: (rows, len(_COLUMNS[name])) for name, rows in OBJECT_ROWS.items()}
        self.space: spaces.Space[Any] = spaces.Dict(
            {
                name: spaces.Box(-_REACH, _REACH, shape, np.float32)
                for name, shape in {"ego": (len(EGO),), **shapes}.items()
            }
        )

    def reset(self, context: PlannerContext) -> None:
        """An episode begins."""
        self._addressed.reset(context)

    def encode(self, observation: Observation) -> Any:
        """ego (7,), route (20, 2) each metre from 1 m on, actors (30, 9), obstacles (8, 7), signs (8, 15)."""
        o, ego = observation, observation.ego
        c, s = math.cos(ego.heading), math.sin(ego.heading)

        def place(x: float, y: float, heading: float) -> tuple[float, float, float, float]:
            dx, dy, turn = x - ego.x, y - ego.y, heading - ego.heading
            return c * dx + s * dy, c * dy - s * dx, math.cos(turn), math.sin(turn)

        state = (ego.speed, ego.acceleration, ego.steering, ego.yaw_rate, o.route.d)
        line = o.route.path.line
        ahead = (line.point_at(min(o.route.s + k + 1.0, line.length)) for k in range(OBJECT_ROWS["route"]))
        boxes = zip(o.actors.boxes, o.actors.speed.tolist(), o.actors.kind.tolist(), strict=True)
        bodies = ((1.0, *place(*b[:3]), v, b[3], b[4], float(kind)) for b, v, kind in boxes)
        fixed = ((1.0, *place(t.x, t.y, t.heading), t.length, t.width) for t in o.obstacles)
        plates = (
            (
                *(1.0, *place(p.x, p.y, p.heading), float(self._codes.get(p.code, 0)), p.value or 0.0),
                *(*whose, float(self._outlines.get(p.outline, 0)), *main_road(p)),
            )
            for p, whose in zip(o.signs, self._addressed(o), strict=True)
        )
        return {
            "ego": np.array(
                (*state, min(o.route.remaining, _FAR_M), o.route.path.limit_at(o.route.s)), dtype=np.float32
            ),
            "route": np.array([place(x, y, 0.0)[:2] for x, y in ahead], dtype=np.float32),
            "actors": _table("actors", bodies),
            "obstacles": _table("obstacles", fixed),
            "signs": _table("signs", plates),
        }


def _table(name: str, rows: Iterable[Sequence[float]]) -> Table:
    table = np.zeros((OBJECT_ROWS[name], len(_COLUMNS[name])), dtype=np.float32)
    nearest = sorted(rows, key=lambda row: math.hypot(row[1], row[2]))[: OBJECT_ROWS[name]]
    if nearest:
        table[: len(nearest)] = nearest
    return table


Floats = npt.NDArray[np.float64]

FAR_M, SPEED_MPS, LIMIT_KMH, LENGTH_M, WIDTH_M, WAY_M, LANES = 100.0, 30.0, 130.0, 20.0, 5.0, 1000.0, 4.0
ROWS = {"plates": 8, "lanes": 64, "actors": 24, "obstacles": 8}
# Of a plate, behind its pose and before the one-hot code; `lanes_left` over `LANES`.
PLATE = ("has_value", "value", *ADDRESSED, *MAIN_ROAD, *OUTLINES)
_ON_ROUTE = 4 + PLATE.index("on_route")
_MAIN_ROAD = PLATE.index(MAIN_ROAD[0])
# Of a piece of a lane, behind its points.
LANE = ("width", "speed", "junction", "on_route", "leads", "way")
POINTS, ROUTE = 8, 20
_PIECE_M, _ROUTE_STEP_M, _YAW_RADPS, _ACCEL_MPS2 = 40.0, 2.5, 1.0, 10.0
_M = f"{FAR_M:g} m"
_POSE = {
    "forward": (_M, "place ahead of the ego"),
    "left": (_M, "place to the left of the ego"),
    "cos": ("1", "cosine of its heading against the ego's"),
    "sin": ("1", "sine of its heading against the ego's"),
}
_SIZE = {"length": (f"{LENGTH_M:g} m", "of its box"), "width": (f"{WIDTH_M:g} m", "of its box")}
_ANGLE = "of a direction of the main road on 8.13 against the approach; 0 without 8.13"


def scene_columns() -> list[tuple[str, str, str, str]]:
    """Of `scene`, below heads: table, column, unit (what 1 stands for) and meaning, in the order of the columns."""
    tables = {
        "ego": dict(
            zip(
                EGO,
                (
                    (f"{SPEED_MPS:g} m/s", "of the ego"),
                    (f"{_ACCEL_MPS2:g} m/s²", "of the ego"),
                    (f"{math.degrees(MAX_STEER_RAD):.0f}°", "angle, to the left"),
                    (f"{_YAW_RADPS:g} rad/s", "to the left"),
                    (f"{WIDTH_M:g} m", "place to the left of the route"),
                    (f"{WAY_M:g} m", "way that is left"),
                    (f"{SPEED_MPS:g} m/s", "of the road, without plates"),
                ),
                strict=True,
            )
        ),
        "route": dict.fromkeys(ROUTE_COLUMNS, (_M, f"of {ROUTE} points, each {_ROUTE_STEP_M:g} m further on")),
        "plates": {
            **_POSE,
            "has_value": ("yes", "a value is told"),
            "value": (f"{LIMIT_KMH:g} km/h", "of the plate"),
            "one_lane": ("yes", "it addresses one lane, not the whole road"),
            "lanes_left": (f"{LANES:g} lanes", "by how many that lane lies to the left of the ego's"),
            "on_route": ("yes", "its road is on the navigation's way"),
            **{name: ("1", ("cosine " if "cos" in name else "sine ") + _ANGLE) for name in MAIN_ROAD},
            **dict.fromkeys(OUTLINES, ("yes", "its outline")),
            "code": ("yes", "a column for each sign, sorted by code, and one for a code that is not told"),
        },
        "lanes": {
            **{f"{name}_{k + 1}": (_M, "of a point of the piece") for k in range(POINTS) for name in ROUTE_COLUMNS},
            "width": (f"{WIDTH_M:g} m", "of the lane"),
            "speed": (f"{SPEED_MPS:g} m/s", "limit of the lane, without plates"),
            "junction": ("yes", "it leads through a junction"),
            "on_route": ("yes", "it is on the navigation's way"),
            "leads": ("yes", "it leads to the destination"),
            "way": (f"{WAY_M:g} m", "to the destination; 1 where it does not lead there"),
        },
        "actors": {
            **_POSE,
            "speed": (f"{SPEED_MPS:g} m/s", "of the road user"),
            **_SIZE,
            **{kind.name.lower(): ("yes", "its kind") for kind in ActorKind},
        },
        "obstacles": {**_POSE, **_SIZE},
    }
    rows = ((table, column, *told) for table, columns in tables.items() for column, told in columns.items())
    return [("table", "column", "unit", "meaning"), *rows]


class SceneSeen:
    """A dictionary of tables; `codes` are the catalogue's signs in the order of the one-hot columns, then not told.

    lanes: with roads; without them it is `plates`.
    """

    def __init__(self, lanes: bool = True) -> None:
        self._with_lanes = lanes
        self.codes = (*sign_codes(), "")
        self._column = {code: k for k, code in enumerate(self.codes)}
        self._kind = {int(kind): k for k, kind in enumerate(ActorKind)}
        self._addressed = AddressedLanes()
        columns = {
            "plates": 4 + len(PLATE) + len(self.codes),
            "lanes": 2 * POINTS + len(LANE),
            "actors": 7 + len(self._kind),
            "obstacles": 6,
        }
        if not lanes:
            del columns["lanes"]
        shapes: dict[str, tuple[int, ...]] = {"ego": (len(EGO),), "route": (ROUTE, 2)}
        shapes |= {name: (ROWS[name], width) for name, width in columns.items()}
        self._shapes = shapes
        tables: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(-1.0, 1.0, shape, np.float32) for name, shape in shapes.items()
        }
        masks = {f"{name}_mask": spaces.Box(0.0, 1.0, (ROWS[name],), np.float32) for name in columns}
        self.space: spaces.Space[Any] = spaces.Dict({**tables, **masks})

    def reset(self, context: PlannerContext) -> None:
        """Cut the map's lanes into pieces once; find which of them lead to the destination."""
        self._addressed.reset(context)
        if not self._with_lanes:
            return
        ways = ways_to(context.graph, context.destination.edge)
        onto = {v: c.to_lane for c in context.network.connections for v in c.via}
        points, fields, edges = [], [], []
        for lane in context.network.lanes:
            edge = context.network.lanes[onto.get(lane.index, lane.index)].edge
            way = ways.get(edge)
            known, left = float(way is not None), 1.0 if way is None else way / WAY_M
            facts = (lane.width / WIDTH_M, lane.speed / SPEED_MPS, float(lane.internal), 0.0, known, left)
            count = max(math.ceil(lane.line.length / _PIECE_M), 1)
            at = np.linspace(0.0, lane.line.length, count * (POINTS - 1) + 1)
            x, y = (np.interp(at, lane.line.s, lane.line.points[:, k]) for k in (0, 1))
            line = np.column_stack((x, y))
            for k in range(count):
                points.append(line[k * (POINTS - 1) : (k + 1) * (POINTS - 1) + 1])
                fields.append(facts)
                edges.append(edge)
        self._points, self._fields, self._edges = np.array(points), np.array(fields), np.array(edges)
        self._way: tuple[str, ...] = ()

    def encode(self, observation: Observation) -> Any:
        """ego, route, and plates, actors, obstacles and lanes with a mask each."""
        o, ego, route = observation, observation.ego, observation.route
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        turn = np.array(((c, -s), (s, c)))
        here = np.array((ego.x, ego.y))

        def place(xy: Floats) -> Floats:
            moved: Floats = (xy - here) @ turn
            return moved / FAR_M

        def poses(rows: Floats) -> Floats:
            angle = rows[:, 2] - ego.heading
            return np.column_stack((place(rows[:, :2]), np.cos(angle), np.sin(angle)))

        line = route.path.line
        steps = np.minimum(route.s + _ROUTE_STEP_M * np.arange(1, ROUTE + 1), line.length)
        ahead = np.column_stack([np.interp(steps, line.s, line.points[:, k]) for k in (0, 1)])
        own = ego.speed / SPEED_MPS, ego.acceleration / _ACCEL_MPS2, ego.steering / MAX_STEER_RAD
        on_route = route.d / WIDTH_M, min(route.remaining, WAY_M) / WAY_M
        limit = route.path.limit_at(route.s) / SPEED_MPS
        state = (*own, ego.yaw_rate / _YAW_RADPS, *on_route, limit)
        found = {"ego": _scaled(np.array(state)), "route": _scaled(place(ahead))}
        plates = np.array([(p.x, p.y, p.heading) for p in o.signs]).reshape(-1, 3)
        fixed = np.array([(t.x, t.y, t.heading) for t in o.obstacles]).reshape(-1, 3)
        sizes = np.array([(t.length / LENGTH_M, t.width / WIDTH_M) for t in o.obstacles]).reshape(-1, 2)
        tables = {
            "plates": np.hstack((poses(plates), self._identity(o))),
            "actors": np.hstack((poses(o.actors.pose), self._bodies(o))),
            "obstacles": np.hstack((poses(fixed), sizes)),
        }
        if self._with_lanes:
            tables["lanes"] = self._lanes(route.path.edges, here, place)
        for name, rows in tables.items():
            found[name], found[f"{name}_mask"] = self._padded(name, rows)
        return found

    def _identity(self, o: Observation) -> Floats:
        rows = np.zeros((len(o.signs), len(PLATE) + len(self.codes)))
        rows[:, 2 : 2 + len(ADDRESSED)] = self._addressed(o) / (1.0, LANES, 1.0)
        for k, plate in enumerate(o.signs):
            if plate.value is not None:
                rows[k, :2] = 1.0, plate.value / LIMIT_KMH
            rows[k, _MAIN_ROAD : _MAIN_ROAD + len(MAIN_ROAD)] = main_road(plate)
            if plate.outline:
                rows[k, PLATE.index(plate.outline)] = 1.0
            if plate.code not in self._column:
                raise InputError(f"plate {plate.code!r}: not in the catalogue, so `scene` has no column for it")
            rows[k, len(PLATE) + self._column[plate.code]] = 1.0
        return rows

    def _bodies(self, o: Observation) -> Floats:
        a = o.actors
        kinds = np.zeros((len(a), len(self._kind)))
        for k, kind in enumerate(a.kind.tolist()):
            kinds[k, self._kind[kind]] = 1.0
        return np.hstack((np.column_stack((a.speed / SPEED_MPS, a.length / LENGTH_M, a.width / WIDTH_M)), kinds))

    def _lanes(self, way: tuple[str, ...], here: Floats, place: Any) -> Floats:
        if way is not self._way:
            self._way = way
            self._fields[:, LANE.index("on_route")] = np.isin(self._edges, way)
        away = ((self._points - here) ** 2).sum(axis=2).min(axis=1)
        count = min(ROWS["lanes"], len(away))
        near = np.argpartition(away, count - 1)[:count]
        near = near[np.argsort(away[near], kind="stable")]
        near = near[away[near] < FAR_M * FAR_M]
        lines = place(self._points[near].reshape(-1, 2)).reshape(len(near), -1)
        return np.hstack((lines, self._fields[near]))

    def _padded(self, name: str, rows: Floats) -> tuple[Table, Table]:
        table, mask = np.zeros(self._shapes[name], np.float32), np.zeros(ROWS[name], np.float32)
        if name != "lanes":
            off_route = 1.0 - rows[:, _ON_ROUTE] if name == "plates" else np.zeros(len(rows))
            rows = rows[np.lexsort((np.hypot(rows[:, 0], rows[:, 1]), off_route))]
        rows = rows[: ROWS[name]]
        table[: len(rows)], mask[: len(rows)] = _scaled(rows), 1.0
        return table, mask


def _scaled(values: Floats) -> Table:
    return np.clip(values, -1.0, 1.0).astype(np.float32)


class ObservationEncoder(Protocol):
    """One kind of observation; `encode` gives elements of `space`."""

    space: spaces.Space[Any]

    def reset(self, context: PlannerContext) -> None: ...

    def encode(self, observation: Observation) -> Any: ...


class VectorSeen(VectorEncoder):
    """`vector`: the 275 numbers of `ppo`."""

    space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)


class BevSeen(RasterEncoder):
    """The raster and the measurements of `carl`."""

    space: spaces.Space[Any] = spaces.Dict(
        {
            "bev": spaces.Box(0, 255, (CHANNELS, PIXELS, PIXELS), np.uint8),
            "measurements": spaces.Box(-2.0, 2.0, (MEASUREMENTS,), np.float32),
        }
    )

    def encode(self, observation: Observation) -> Any:
        raster, measured = super().encode(observation)
        return {"bev": raster, "measurements": measured}


KINDS: dict[str, Callable[[], ObservationEncoder]] = {
    "vector": VectorSeen,
    "bev": BevSeen,
    "objects": ObjectsSeen,
    "scene": SceneSeen,
    "plates": partial(SceneSeen, lanes=False),
}
