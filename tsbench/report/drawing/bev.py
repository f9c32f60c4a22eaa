"""Bird's-eye view of one episode: the ground drawn once, then tick by tick what moves.

Fast enough for bulk video: a frame is a copy of a part of the ground and a few dozen small shapes.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from types import MappingProxyType

import cv2
import numpy as np

from tsbench.episode.trace import Trace
from tsbench.episode.witness import Witness
from tsbench.geometry.polyline import Array
from tsbench.report.description import episode_subtitle, episode_title
from tsbench.report.drawing.camera import SHIFT, Camera, Fixed, Image, camera_over
from tsbench.report.drawing.hud import FrameInfo, Hud, draw_attribution, draw_scale_bar
from tsbench.report.drawing.paint import paint, paint_outline
from tsbench.report.drawing.roads import road_shapes
from tsbench.report.drawing.scene import body_kind, ego_body, furniture_shapes, tick_shapes
from tsbench.report.drawing.shapes import Body
from tsbench.report.drawing.style import STYLE
from tsbench.report.drawing.text import label
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.sealed import seal
from tsbench.rules.base import Violation
from tsbench.signs.countries import Country
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import EGO_ID
from tsbench.sim.world import Indicator

WHOLE_SCENE_PX_PER_M = 6.0
FOLLOW_PX_PER_M = 7.0
LARGEST_PX_PER_M = 14.0
_EDGE_PX = 8
_ROUTE_STEP_M = 2.0
_SIDES = MappingProxyType({Indicator.NONE: 0, Indicator.LEFT: 1, Indicator.RIGHT: -1})


@dataclass(frozen=True, slots=True)
class PageSize:
    """A picture in px, header and footer included. Video encoders want even numbers."""

    width: int
    height: int

    @property
    def view_height(self) -> int:
        return self.height - STYLE.header_px - STYLE.footer_px


class BirdsEye:
    """Draws pages of one episode.

    around: (n, 2) points that the picture must show; a scene that they do not fit into is followed by a
    camera that keeps the ego in its middle. country: whose plates and codes are shown; by default the city's.
    """

    def __init__(
        self, trace: Trace, scene: Scene, size: PageSize, around: Array, follow: bool,
        country: Country | None = None,
    ) -> None:  # fmt: skip
        self.trace, self.scene, self.size, self._country = trace, scene, size, country
        view = seal(scene.network)
        self._views, self._witness = trace.routes(view, scene), Witness(scene.network, view)
        self._track = np.array([(s.ego.x, s.ego.y) for s in trace.snapshots])
        bounds = (FOLLOW_PX_PER_M if follow else WHOLE_SCENE_PX_PER_M / 2, LARGEST_PX_PER_M)
        self._still = camera_over(around, size.width, size.view_height, 8.0, bounds)
        self._follow = follow and not _shows(self._still, around)
        self._ground_camera = self._over_track() if self._follow else self._still
        camera = self._ground_camera
        self.ground: Image = np.full((camera.height, camera.width, 3), STYLE.ground, dtype=np.uint8)
        paint(self.ground, camera, (*road_shapes(scene.network), *furniture_shapes(scene, country)))
        self._windows = self._make_windows()
        self._last = max(trace.snapshots[-1].time, 1e-9)
        self._hud = self._make_hud()
        self._paths: dict[int, tuple[RoutePath, Array, Fixed]] = {}
        self._trailed = 0
        self._marked = 0

    def _over_track(self) -> Camera:
        """A ground that holds every window of the following camera."""
        scale, size = FOLLOW_PX_PER_M, self.size
        low, high = self._track.min(axis=0), self._track.max(axis=0)
        width = math.ceil((high[0] - low[0]) * scale) + size.width + 2 * _EDGE_PX
        height = math.ceil((high[1] - low[1]) * scale) + size.view_height + 2 * _EDGE_PX
        left = float(low[0]) - (size.width / 2 + _EDGE_PX) / scale
        top = float(high[1]) + (size.view_height / 2 + _EDGE_PX) / scale
        return Camera(left, top, scale, width, height)

    def _make_hud(self) -> Hud:
        trace = self.trace
        shares = [v.start_s / self._last for v in trace.events]
        return Hud(
            self.size.width, episode_title(trace), episode_subtitle(trace, self._country),
            self.scene.target_sign, shares, self._kinds(), self._country,
        )  # fmt: skip

    def _kinds(self) -> frozenset[str]:
        """What there is to be seen, for the legend."""
        table = self.trace.snapshots[-1].actors.table
        found = {body_kind(table, row) for row in range(len(table.ids))}
        return frozenset(found | ({"plan"} if any(plan is not None for plan in self.trace.plans) else set()))

    def page(self, tick: int, out: Image | None = None) -> Image:
        """The page of one tick, (height, width, 3) RGB. Ticks must not run backwards: the trail only grows.

        out: an array to draw into.
        """
        page = np.empty((self.size.height, self.size.width, 3), dtype=np.uint8) if out is None else out
        self._mark(self.trace.snapshots[tick].time)
        self._trail(tick)
        view = page[STYLE.header_px : self.size.height - STYLE.footer_px]
        self._draw_view(view, tick)
        moment = self._moment(tick)
        self._hud.header(page, moment)
        self._hud.footer(page, moment)
        return page

    def _draw_view(self, view: Image, tick: int) -> None:
        left, top = self._windows[tick]
        camera = self._ground_camera.window(left, top, view.shape[1], view.shape[0])
        view[:] = self.ground[top : top + view.shape[0], left : left + view.shape[1]]
        self._draw_route(view, tick, left, top)
        self._draw_plan(view, tick, camera)
        bodies = self._bodies(tick)
        paint(view, camera, bodies)
        self._name(view, camera, bodies, tick)
        draw_scale_bar(view, camera.scale)
        draw_attribution(view)

    def _name(self, view: Image, camera: Camera, bodies: list[Body], tick: int) -> None:
        """The names of those that the violations so far speak of, beside them."""
        now = self.trace.snapshots[tick].time + 1e-6
        said = " ".join(event.sentence for event in self.trace.events if event.start_s <= now)
        for body in bodies:
            if body.name != EGO_ID and re.search(rf"\b{re.escape(body.name)}\b", said):
                x, y = np.rint(camera.px([(body.x, body.y)])[0]).astype(int).tolist()
                name = label(body.name, 13, STYLE.ink, STYLE.outline)
                height, width = name.share.shape[:2]
                if 0 <= x + 14 <= view.shape[1] - width and 0 <= y - 34 <= view.shape[0] - height:
                    name.lay(view, x + 14, y - 34)

    def _bodies(self, tick: int) -> list[Body]:
        """Who is there, with the lights that others show."""
        snapshot = self.trace.snapshots[tick]
        bodies = tick_shapes(snapshot, self.trace.snapshots[tick - 1] if tick else None)
        seen = self._witness.see(snapshot.actors, snapshot.ego)
        sides = {
            (x, y): _SIDES[i]
            for (x, y, _), i in zip(seen.pose.tolist(), seen.indicator.tolist(), strict=True)
        }
        return [replace(body, signals=sides.get((body.x, body.y), 0)) for body in bodies]

    def _make_windows(self) -> list[tuple[int, int]]:
        """Of each tick, the view's upper left corner in the ground, whole px so that the ground is copied as it is."""
        if not self._follow:
            return [(0, 0)] * len(self._track)
        view = np.array((self.size.width, self.size.view_height))
        room = np.array((self._ground_camera.width, self._ground_camera.height)) - view
        corners = np.rint(self._ground_camera.px(self._track) - view / 2).astype(int)
        return [(left, top) for left, top in np.clip(corners, 0, room).tolist()]

    def _draw_route(self, view: Image, tick: int, left: int, top: int) -> None:
        route = self._views[tick]
        key = id(route.path)
        if key not in self._paths:
            line = route.path.line.resampled(_ROUTE_STEP_M)
            self._paths[key] = (route.path, line.s, self._ground_camera.fixed(line.points))
        _, s, fixed = self._paths[key]
        first, last = np.searchsorted(s, (route.s, route.path.destination_s)).tolist()
        if last - first > 1 and math.isfinite(route.remaining):
            points = fixed[first:last] - np.array((left << SHIFT, top << SHIFT), dtype=np.int32)
            cv2.polylines(view, [points], False, STYLE.route, 2, cv2.LINE_AA, SHIFT)

    def _draw_plan(self, view: Image, tick: int, camera: Camera) -> None:
        """Where the planner meant to drive from here, where it told so."""
        plan = self.trace.plans[tick] if tick < len(self.trace.plans) else None
        if plan is not None and len(plan) > 1:
            cv2.polylines(view, [camera.fixed(plan)], False, STYLE.plan, 2, cv2.LINE_AA, SHIFT)

    def _trail(self, tick: int) -> None:
        if tick > self._trailed:
            points = self._ground_camera.fixed(self._track[self._trailed : tick + 1])
            cv2.polylines(self.ground, [points], False, STYLE.trail, 2, cv2.LINE_AA, SHIFT)
            self._trailed = tick

    def _mark(self, time: float) -> None:
        events = self.trace.events
        while self._marked < len(events) and events[self._marked].start_s <= time + 1e-6:
            mark_violation(self.ground, self._ground_camera, events[self._marked])
            self._marked += 1

    def _moment(self, tick: int) -> FrameInfo:
        snapshot = self.trace.snapshots[tick]
        begun = [v for v in self.trace.events if v.start_s <= snapshot.time + 1e-6]
        ended = tick == len(self.trace.snapshots) - 1
        return FrameInfo(
            time=snapshot.time,
            speed=snapshot.ego.speed,
            progress=min(snapshot.time / self._last, 1.0),
            event=max(begun, key=lambda v: v.start_s) if begun else None,
            outcome=str(self.trace.outcome) if ended else "",
        )


def mark_violation(image: Image, camera: Camera, event: Violation) -> None:
    """A ring with a cross where the ego was when it broke the rule, and its outline."""
    paint_outline(image, camera, ego_body(event.x, event.y, event.heading), STYLE.violation)
    centre = camera.fixed([(event.x, event.y)])[0]
    radius = round(4.0 * camera.scale * (1 << SHIFT))
    cv2.circle(image, centre.tolist(), radius, STYLE.marking, 5, cv2.LINE_AA, SHIFT)
    cv2.circle(image, centre.tolist(), radius, STYLE.violation, 3, cv2.LINE_AA, SHIFT)
    for sign in (-1, 1):
        arm = np.array((round(radius * 0.35), round(radius * 0.35) * sign))
        ends = [(centre - arm).tolist(), (centre + arm).tolist()]
        cv2.line(image, ends[0], ends[1], STYLE.violation, 2, cv2.LINE_AA, SHIFT)


def _shows(camera: Camera, points: Array) -> bool:
    px = camera.px(points)
    return bool(np.all((px >= 0) & (px <= (camera.width, camera.height))))
