"""What `render` shows: a scene from above, north up, the ego in the middle. Units: m, px.

A quick look at a training; the pictures of a run (`tsbench render`) are drawn from its traces and show more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from tsbench.core.errors import InputError
from tsbench.planners.base import PlannerContext
from tsbench.planners.observation import Observation
from tsbench.report.drawing.canvas import STYLE, Area, Body, Image, Line, Shape, camera_at, lane_area
from tsbench.report.drawing.paint import paint, paste, tile, write
from tsbench.report.drawing.scene_shapes import ego_body
from tsbench.sim.world import ActorKind

SIZE_PX, _PX_PER_M, _TEXT_PX = 512, 6.0, 13


class View:
    def __init__(self, context: PlannerContext) -> None:
        lanes, junctions = context.network.lanes, context.network.junctions.values()
        areas = [lane_area(lane.line, lane.width) for lane in lanes]
        areas += [shapely.Polygon(junction.polygon).buffer(0) for junction in junctions if len(junction.polygon) > 2]
        sides = [lane.line.beside(side * lane.width) for lane in lanes if not lane.internal for side in (-0.5, 0.5)]
        self._road: list[Shape] = [Area("asphalt", shapely.union_all(areas))]
        self._road += [Line("marking", side, 0.15) for side in sides]

    def draw(self, observation: Observation) -> Image:
        """(512, 512, 3) uint8, RGB."""
        o = observation
        picture: Image = np.full((SIZE_PX, SIZE_PX, 3), STYLE.ground, dtype=np.uint8)
        camera = camera_at(o.ego.x, o.ego.y, _PX_PER_M, SIZE_PX, SIZE_PX)
        paint(picture, camera, (*self._road, *_shapes(o)))
        for plate in o.signs:
            x, y = camera.px((plate.x, plate.y))[0].astype(int).tolist()
            value = "" if plate.value is None else f" {plate.value:g}"
            board = tile(f"{plate.code or plate.outline or '?'}{value}", _TEXT_PX, STYLE.outline, STYLE.marking)
            paste(picture, x + 8, y - 8, board, np.full(board.shape[:2], 255, dtype=np.uint8))
        write(picture, 10, 10, f"{o.time:.1f} s  {3.6 * o.ego.speed:.0f} km/h", _TEXT_PX, STYLE.outline)
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


def _shapes(o: Observation) -> Iterator[Shape]:
    yield Line("route", o.route.path.line.points, 0.4)
    for thing in o.obstacles:
        yield Body("island", thing.id, thing.x, thing.y, thing.heading, thing.length, thing.width)
    for box, kind in zip(o.actors.boxes, o.actors.kind.tolist(), strict=True):
        yield Body(ActorKind(kind).name.lower(), "", *box)
    yield ego_body(o.ego.x, o.ego.y, o.ego.heading)
    for plate in o.signs:
        yield Area("violation", shapely.Point(plate.x, plate.y).buffer(0.8))
