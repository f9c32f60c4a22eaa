"""What `render` shows: a scene from above in the environment's own process, with OpenCV. Units: m, px.

A quick look at a training; the pictures of a run (`tsbench render`) are drawn from its traces and show more.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError
from tsbench.geometry.footprint import corners
from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.geometry import lane_polygon
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M, ActorKind

Image = npt.NDArray[np.uint8]
SIZE_PX, _SCALE = 512, 6.0
# Fractions of a pixel that OpenCV draws with: 4 bits.
_BITS = 4
_GROUND, _ROAD, _LINE, _ROUTE = (232, 236, 228), (190, 190, 190), (255, 255, 255), (110, 170, 110)
_EGO, _CAR, _PERSON, _THING, _PLATE = ((32, 96, 200), (90, 90, 90), (200, 120, 30), (220, 140, 0), (180, 20, 20))


def shown_here(modes: Sequence[str]) -> list[str]:
    """The render modes that this machine has: `human` needs a screen, or another backend of Matplotlib's."""
    backend = os.environ.get("MPLBACKEND", "")
    window = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or backend
    return [mode for mode in modes if mode != "human" or (window and backend.lower() != "agg")]


class View:
    """Pictures of 512 x 512 px, RGB, 6 px a metre, north up, the ego in the middle."""

    def __init__(self, context: PlannerContext) -> None:
        self._areas = [lane_polygon(lane) for lane in context.network.lanes]
        self._areas += [junction.polygon for junction in context.network.junctions.values()]

    def draw(self, observation: Observation) -> Image:
        """(512, 512, 3) uint8."""
        o = observation
        self._middle = np.array((o.ego.x, o.ego.y))
        picture: Image = np.full((SIZE_PX, SIZE_PX, 3), _GROUND, dtype=np.uint8)
        for area in self._areas:
            if len(area) > 2:
                self._fill(picture, area, _ROAD)
        for area in self._areas:
            self._outline(picture, area, _LINE, 1, closed=True)
        self._outline(picture, o.route.path.line.points, _ROUTE, 2)
        for thing in o.obstacles:
            self._box(picture, (thing.x, thing.y, thing.heading, thing.length, thing.width), _THING)
        for box, kind in zip(o.actors.boxes, o.actors.kind.tolist(), strict=True):
            self._box(picture, box, _PERSON if kind == ActorKind.PEDESTRIAN else _CAR)
        self._box(picture, (o.ego.x, o.ego.y, o.ego.heading, EGO_LENGTH_M, EGO_WIDTH_M), _EGO)
        for plate in o.signs:
            x, y = (int(v) for v in self._pixels(np.array(((plate.x, plate.y),)))[0])
            cv2.circle(picture, (x, y), 5, _PLATE, -1, cv2.LINE_AA)
            value = "" if plate.value is None else f" {plate.value:g}"
            self._text(picture, f"{plate.code or plate.outline or '?'}{value}", (x + 8, y + 4))
        self._text(picture, f"{o.time:.1f} s  {3.6 * o.ego.speed:.0f} km/h", (10, 20))
        return picture

    def show(self, observation: Observation) -> None:
        """In a window of Matplotlib's. Raises InputError where there is no screen."""
        from matplotlib import pyplot

        backend = pyplot.get_backend()
        if backend.lower() == "agg":
            raise InputError(
                f"render_mode 'human': Matplotlib has no window here (backend {backend}): take 'rgb_array', or set "
                "DISPLAY and MPLBACKEND"
            )
        picture = self.draw(observation)
        pyplot.figure("tsbench", clear=True)
        pyplot.imshow(picture)
        pyplot.axis("off")
        pyplot.pause(0.001)

    def _pixels(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        moved = (points - self._middle) * _SCALE
        return np.column_stack((SIZE_PX / 2 + moved[:, 0], SIZE_PX / 2 - moved[:, 1]))

    def _fixed(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.int32]:
        found: npt.NDArray[np.int32] = np.round(self._pixels(points) * 2**_BITS).astype(np.int32)
        return found[None]

    def _fill(self, picture: Image, area: npt.NDArray[np.float64], colour: tuple[int, int, int]) -> None:
        cv2.fillPoly(picture, list(self._fixed(area)), colour, cv2.LINE_AA, _BITS)

    def _outline(
        self,
        picture: Image,
        points: npt.NDArray[np.float64],
        colour: tuple[int, int, int],
        width: int,
        *,
        closed: bool = False,
    ) -> None:
        cv2.polylines(picture, list(self._fixed(points)), closed, colour, width, cv2.LINE_AA, _BITS)

    def _box(self, picture: Image, box: tuple[float, float, float, float, float], colour: tuple[int, int, int]) -> None:
        self._fill(picture, np.array(corners(*box)), colour)
        x, y, heading, length, _ = box
        ahead = (x + math.cos(heading) * length / 2, y + math.sin(heading) * length / 2)
        self._outline(picture, np.array(((x, y), ahead)), _LINE, 1)

    def _text(self, picture: Image, text: str, at: tuple[int, int]) -> None:
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (20, 20, 20), 1, cv2.LINE_AA)
