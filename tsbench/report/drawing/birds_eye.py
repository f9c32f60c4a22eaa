"""Bird's-eye view of one episode: the ground drawn once, then tick by tick what moves.

Fast enough for bulk video: a frame is a copy of a part of the ground and a few dozen small shapes. `mark_violation`
draws violations; the player of a report draws all of this itself (`tsbench/report/page/static/bev.js`).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from tsbench.episode.trace import Trace
from tsbench.episode.traffic_view import TrafficView
from tsbench.geometry.polyline import Array
from tsbench.report.drawing.canvas import SHIFT, STYLE, Body, Camera, Fixed, Image, PageSize, camera_over, rounded_along
from tsbench.report.drawing.hud import FrameInfo, Hud, draw_attribution, draw_scale_bar
from tsbench.report.drawing.paint import paint, paint_outline, plate_px, stamp, tile, write
from tsbench.report.drawing.road_shapes import ground_shapes, road_shapes
from tsbench.report.drawing.scene_shapes import (
    body_kind,
    ego_body,
    furniture_shapes,
    named_from,
    obstacle_bodies,
    tick_shapes,
)
from tsbench.report.time_to_collision import how_near
from tsbench.report.wording import episode_subtitle, episode_title
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.planner_map import build_planner_map
from tsbench.rules.monitor import Violation
from tsbench.signs.countries import Artwork, Country
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

_PAD_PX, _TITLE_PX, _FONT = 4, 13, 10
# What an axis shows at least.
_SPEED_KMH, _ACCELERATION_MPS2 = (0.0, 20.0), (-2.0, 2.0)
_AXIS = (70, 76, 84)


class Strip:
    """Both curves, one below the other, over the same time as the time line of the footer below them."""

    def __init__(self, trace: Trace, width: int, height: int) -> None:
        """trace: of an episode; width, height: px."""
        self._image: Image = np.full((height, width, 3), STYLE.panel, dtype=np.uint8)
        time = np.array([s.time for s in trace.snapshots])
        self._last = max(float(time[-1]), 1e-9)
        half = height // 2
        accelerations = np.array([s.ego.acceleration for s in trace.snapshots])
        panels = (
            ("speed", "km/h", 3.6 * np.array([s.ego.speed for s in trace.snapshots]), _SPEED_KMH),
            ("acceleration", "m/s²", accelerations, _ACCELERATION_MPS2),
        )
        for k, (name, unit, values, least) in enumerate(panels):
            part = self._image[k * half : (k + 1) * half]
            for event in trace.against:
                left, right = self._x(event.start_s), self._x(event.end_s)
                part[:, left : max(right, left + 2)] = (70, 36, 42)
            self._draw(part, time, values, f"{name}, {unit}", least)

    def _x(self, time: float) -> int:
        return round(min(time / self._last, 1.0) * (int(self._image.shape[1]) - 1))

    def _draw(self, part: Image, time: Array, values: Array, title: str, least: tuple[float, float]) -> None:
        low, high = min(least[0], float(values.min())), max(least[1], float(values.max()))
        top, bottom = _TITLE_PX + 1, part.shape[0] - _PAD_PX
        y = bottom - (values - low) / (high - low) * (bottom - top)
        zero = round(bottom - (0.0 - low) / (high - low) * (bottom - top))
        part[zero, :] = _AXIS
        points = np.column_stack((time / self._last * (part.shape[1] - 1), y))
        fixed = np.rint(points * (1 << SHIFT)).astype(np.int32)
        cv2.polylines(part, [fixed], False, STYLE.trail, 2, cv2.LINE_AA, SHIFT)
        write(part, _PAD_PX, 0, f"{title}, {low + 0.0:.0f} to {high:.0f}", _FONT, STYLE.faint)

    def lay(self, page: Image, top: int, time: float) -> None:
        """Copy it into a page from row `top` on, with a line at `time` (s)."""
        height, x = self._image.shape[0], self._x(time)
        page[top : top + height] = self._image
        page[top : top + height, max(x - 1, 0) : x + 1] = STYLE.ink


WHOLE_SCENE_PX_PER_M = 6.0
FOLLOW_PX_PER_M = 7.0
LARGEST_PX_PER_M = 14.0
_EDGE_PX = 8
_MARGIN_M = 6.0
_ROUTE_STEP_M = 2.0


class BirdsEye:
    """Draws pages of one episode.

    around: (n, 2) points that the picture must show; a scene that they do not fit into is followed by a
    camera that keeps the ego in its middle. country: whose plates and codes are shown; by default the city's.
    named: do the road users that a violation names have their names beside them?
    """

    def __init__(
        self, trace: Trace, scene: Scene, size: PageSize, around: Array, follow: bool,
        country: Country | None = None, named: bool = True, under_way: bool = False,
    ) -> None:  # fmt: skip
        self._under_way = under_way
        self.trace, self.scene, self.size = trace, scene, size
        view = build_planner_map(scene.network)
        self._views, self._traffic_view = trace.routes(view, scene), TrafficView(scene.network, view)
        others = (*trace.snapshots[-1].actors.table.ids, *(o.id for o in scene.obstacles))
        self._named = named_from(trace.against, others) if named else {}
        self._track = np.array([(s.ego.x, s.ego.y) for s in trace.snapshots])
        bounds = (FOLLOW_PX_PER_M if follow else WHOLE_SCENE_PX_PER_M / 2, LARGEST_PX_PER_M)
        self._still = camera_over(around, size.width, size.view_height, _MARGIN_M, bounds)
        px = self._still.px(around)
        self._follow = follow and not ((px >= 0) & (px <= (self._still.width, self._still.height))).all()
        self._ground_camera = self._over_track() if self._follow else self._still
        camera = self._ground_camera
        self.ground: Image = np.full((camera.height, camera.width, 3), STYLE.ground, dtype=np.uint8)
        shapes = (
            *ground_shapes(scene, trace.spec.map_id),
            *road_shapes(scene.network, scene),
            *furniture_shapes(scene, country),
        )
        self._plates = paint(self.ground, camera, shapes)
        self._obstacles = obstacle_bodies(scene)
        self._windows = self._make_windows()
        self._last = max(trace.snapshots[-1].time, 1e-9)
        self._hud = self._make_hud(scene.artwork(country))
        self._strip = Strip(trace, size.width, size.strip_px) if size.strip_px else None
        self._paths: dict[int, tuple[RoutePath, Array, Fixed]] = {}
        self._nearness: dict[Violation, str] = {}
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

    def _make_hud(self, artwork: Artwork) -> Hud:
        trace = self.trace
        shares = [v.start_s / self._last for v in trace.against]
        parts = episode_subtitle(trace, artwork).split(" · ")
        # A narrow page has room for the scenario and its sign.
        subtitle = " · ".join(parts[:2] if self.size.compact else parts)
        # What there is to be seen, for the legend.
        table = trace.snapshots[-1].actors.table
        kinds = {body_kind(table, row) for row in range(len(table.ids))}
        kinds |= {"plan" for plan in trace.plans if plan is not None}
        return Hud(self.size, episode_title(trace), subtitle, self.scene.target_signs, artwork, shares, kinds)

    def page(self, tick: int, out: Image | None = None) -> Image:
        """The page of one tick, (height, width, 3) RGB. Ticks must not run backwards: the trail only grows.

        out: an array to draw into.
        """
        page = np.empty((self.size.height, self.size.width, 3), dtype=np.uint8) if out is None else out
        self._mark(self.trace.snapshots[tick].time)
        if tick > self._trailed:
            points = self._ground_camera.fixed(self._track[self._trailed : tick + 1])
            cv2.polylines(self.ground, [points], False, STYLE.trail, 2, cv2.LINE_AA, SHIFT)
            self._trailed = tick
        top, size = self.size.header_px, self.size
        self._draw_view(page[top : top + size.view_height], tick)
        if self._strip is not None:
            self._strip.lay(page, top + size.view_height, self.trace.snapshots[tick].time)
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
        before = self.trace.snapshots[tick - 1] if tick else None
        # Obstacles once more: they are what a way is to lead around.
        bodies = [*self._obstacles, *tick_shapes(self.trace.snapshots[tick], before, self._traffic_view)]
        paint(view, camera, bodies)
        self._name(view, camera, bodies, tick)
        draw_scale_bar(view, camera.scale)
        draw_attribution(view)

    def _name(self, view: Image, camera: Camera, bodies: list[Body], tick: int) -> None:
        """The names of those that the violations so far speak of, beside them."""
        now = self.trace.snapshots[tick].time + 1e-6
        for body in bodies:
            if self._named.get(body.name, math.inf) <= now:
                name = tile(f" {body.name} ", 13, STYLE.ink, STYLE.panel)
                place = self._free_place(view, camera, body, name.shape[1], name.shape[0])
                if place is not None:
                    stamp(view, *place, name)

    def _free_place(self, view: Image, camera: Camera, body: Body, width: int, height: int) -> tuple[int, int] | None:
        """Beside a body, within the view and off the plates; None where there is no such place."""
        x, y = np.rint(camera.px([(body.x, body.y)])[0]).astype(int).tolist()
        corner = self._ground_camera.px([(camera.left, camera.top)])[0]
        at = np.array(self._plates).reshape(-1, 2) - corner
        reach = plate_px(camera) / 2 + 4
        for left, top in ((x + 14, y - 34), (x - 14 - width, y - 34), (x + 14, y + 16), (x - 14 - width, y + 16)):
            inside = 0 <= left <= view.shape[1] - width and 0 <= top <= view.shape[0] - height
            middle = np.array((left + width / 2, top + height / 2))
            if inside and not (np.abs(at - middle) < (reach + width / 2, reach + height / 2)).all(axis=1).any():
                return left, top
        return None

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
            s, points = rounded_along(route.path.line, _ROUTE_STEP_M)
            self._paths[key] = (route.path, s, self._ground_camera.fixed(points))
        _, along, fixed = self._paths[key]
        first, last = np.searchsorted(along, (route.s, route.path.destination_s)).tolist()
        if last - first > 1 and math.isfinite(route.remaining):
            shown = fixed[first:last] - np.array((left << SHIFT, top << SHIFT), dtype=np.int32)
            cv2.polylines(view, [shown], False, STYLE.route, 2, cv2.LINE_AA, SHIFT)

    def _draw_plan(self, view: Image, tick: int, camera: Camera) -> None:
        """Where the planner meant to drive from here, where it told so."""
        plan = self.trace.plans[tick] if tick < len(self.trace.plans) else None
        if plan is not None and len(plan) > 1:
            cv2.polylines(view, [camera.fixed(plan)], False, STYLE.plan, 2, cv2.LINE_AA, SHIFT)

    def _mark(self, time: float) -> None:
        events = self.trace.against
        while self._marked < len(events) and events[self._marked].start_s <= time + 1e-6:
            mark_violation(self.ground, self._ground_camera, events[self._marked])
            self._marked += 1

    def _moment(self, tick: int) -> FrameInfo:
        snapshot = self.trace.snapshots[tick]
        begun = [v for v in self.trace.against if v.start_s <= snapshot.time + 1e-6]
        ended = tick == len(self.trace.snapshots) - 1 and not self._under_way
        event = max(begun, key=lambda v: v.start_s) if begun else None
        return FrameInfo(
            time=snapshot.time,
            speed=snapshot.ego.speed,
            progress=min(snapshot.time / self._last, 1.0),
            event=event,
            outcome=str(self.trace.outcome) if ended else "",
            near="" if event is None else self._near(event),
        )

    def _near(self, event: Violation) -> str:
        """How near to the ego the road user of an event was when it began."""
        if event not in self._nearness:
            snapshots = self.trace.snapshots
            then = snapshots[min(round(event.start_s / DT_S), len(snapshots) - 1)]
            named = named_from([event], then.actors.table.ids)
            self._nearness[event] = next((text for name in named if (text := how_near(then, name))), "")
        return self._nearness[event]


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
