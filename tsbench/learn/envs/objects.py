"""`objects`: what a planner sees as tables of numbers, plates included, for networks that take sets.

Places are in the ego's frame (m forward, m left), angles as cosine and sine against its heading, speeds in m/s. Rows
are sorted by distance; one that is not there is zero, its first number too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from tsbench.planners.base import Observation, PlannerContext, SignView
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.model import OUTLINES

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
ROUTE = ("forward", "left")
ACTORS = ("there", "forward", "left", "cos", "sin", "speed", "length", "width", "kind")
OBSTACLES = ("there", "forward", "left", "cos", "sin", "length", "width")
SIGNS = ("there", "forward", "left", "cos", "sin", "code", "value", *ADDRESSED, "outline", *MAIN_ROAD)
ROWS = {"route": 20, "actors": 30, "obstacles": 8, "signs": 8}

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
        columns = {"route": ROUTE, "actors": ACTORS, "obstacles": OBSTACLES, "signs": SIGNS}
        shapes: dict[str, tuple[int, ...]] = {name: (ROWS[name], len(columns[name])) for name in columns}
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
        ahead = (line.point_at(min(o.route.s + k + 1.0, line.length)) for k in range(ROWS["route"]))
        boxes = zip(o.actors.boxes, o.actors.speed.tolist(), o.actors.kind.tolist(), strict=True)
        return {
            "ego": np.array(
                (*state, min(o.route.remaining, _FAR_M), o.route.path.limit_at(o.route.s)), dtype=np.float32
            ),
            "route": np.array([place(x, y, 0.0)[:2] for x, y in ahead], dtype=np.float32),
            "actors": _table(
                "actors", len(ACTORS), ((1.0, *place(*b[:3]), v, b[3], b[4], float(kind)) for b, v, kind in boxes)
            ),
            "obstacles": _table(
                "obstacles",
                len(OBSTACLES),
                ((1.0, *place(t.x, t.y, t.heading), t.length, t.width) for t in o.obstacles),
            ),
            "signs": _table(
                "signs",
                len(SIGNS),
                (
                    (
                        1.0,
                        *place(p.x, p.y, p.heading),
                        float(self._codes.get(p.code, 0)),
                        p.value or 0.0,
                        *whose,
                        float(self._outlines.get(p.outline, 0)),
                        *main_road(p),
                    )
                    for p, whose in zip(o.signs, self._addressed(o), strict=True)
                ),
            ),
        }


def _table(name: str, columns: int, rows: Iterable[Sequence[float]]) -> Table:
    table = np.zeros((ROWS[name], columns), dtype=np.float32)
    nearest = sorted(rows, key=lambda row: math.hypot(row[1], row[2]))[: ROWS[name]]
    if nearest:
        table[: len(nearest)] = nearest
    return table
