"""What a planner is shown at each tick. Ranges are part of the benchmark: the same in training and in use."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tsbench.core.benchmark import OBSTACLE_RANGE_M, SIGN_RANGE_M
from tsbench.episode.perception import Plate, SignDetection, SignDetector, faces
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.episode.traffic_view import TrafficView
from tsbench.planners.observation import Observation, SignView
from tsbench.roads.lane_graph import Destination
from tsbench.roads.planner_map import PlannerMap
from tsbench.signs.annotations import SignInstance
from tsbench.sim.main_road import main_roads
from tsbench.sim.navigation import RouteView
from tsbench.sim.scene import Scene
from tsbench.sim.world import EgoState, WorldSnapshot

HISTORY_TICKS = 20


class Observer:
    """Builds observations for one episode; keeps the ego's history. privileged: for an expert?

    luck: a name from which what imperfect perception does is drawn; an episode has its pair's.
    """

    def __init__(
        self, scene: Scene, view: PlannerMap, perception: Perception = EXACTLY, luck: str = "", privileged: bool = False
    ) -> None:
        self._view, self._privileged = view, privileged
        turning = main_roads(scene.network, scene.signs)
        seen = [_plate(view, scene, sign, turning[sign.id].told if sign.id in turning else ()) for sign in scene.signs]
        self._mask = perception.masked
        self._signs = [sign.masked() if self._mask else sign.from_behind() for sign in seen]
        # By place in `_signs`: those that have not faced the ego yet.
        self._unread = {} if self._mask else dict(enumerate(seen))
        self._eyes: SignDetector | None = None
        if perception.level is not None:
            plates = [Plate(sign.id, sign.role, at) for sign, at in zip(scene.signs, seen, strict=True)]
            self._eyes = SignDetector(perception.level, luck, plates, view.map, scene.catalog)
        lane = scene.network.lane_index
        self._obstacles = tuple(
            replace(o, lane=_lane_id(view, lane[o.lane]) if o.lane in lane else "") for o in scene.obstacles
        )
        self._history = np.empty((scene.horizon + 2, 4))
        self._traffic_view = TrafficView(scene.network, view)

    def observe(self, snapshot: WorldSnapshot, seen: EgoState, route: RouteView) -> Observation:
        """The observation at this tick; call once per tick, in order. seen: `ego_on_map` of the snapshot's."""
        ego, k = snapshot.ego, snapshot.step
        self._history[k] = (ego.x, ego.y, ego.heading, ego.speed)
        history = self._history[max(k + 1 - HISTORY_TICKS, 0) : k + 1].copy()
        history.setflags(write=False)
        signs = []
        for s in self._exactly(ego) if self._eyes is None else self._perceived(self._eyes, snapshot, seen):
            distance = math.hypot(s.x - ego.x, s.y - ego.y)
            if distance <= SIGN_RANGE_M:
                # Not `replace`, which takes twice as long: this is each plate at each tick.
                signs.append(
                    SignView(
                        code=s.code, value=s.value, x=s.x, y=s.y, heading=s.heading, edge=s.edge, lane=s.lane,
                        position_m=s.position_m, distance=distance, outline=s.outline, main_road=s.main_road,
                        temporary=s.temporary,
                    )
                )  # fmt: skip
        if len(signs) > 1:
            # Never by the order of the scene's file, which the code of a plate might decide.
            signs.sort(key=lambda sign: (sign.distance, sign.x, sign.y, sign.heading))
        obstacles = self._obstacles and tuple(
            o for o in self._obstacles if math.hypot(o.x - ego.x, o.y - ego.y) <= OBSTACLE_RANGE_M
        )
        return Observation(
            step=k, time=snapshot.time, ego=seen, history=history, route=route,
            actors=self._traffic_view.see(snapshot.actors, ego), signs=tuple(signs), obstacles=obstacles,
            truth=snapshot if self._privileged else None,
        )  # fmt: skip

    def _exactly(self, ego: EgoState) -> list[SignView]:
        """All plates, those that have not faced the ego yet from behind; what is read once is known from then on."""
        for k, plate in list(self._unread.items()):
            if faces(ego, plate):
                self._signs[k] = self._unread.pop(k)
        return self._signs

    def _perceived(self, eyes: SignDetector, snapshot: WorldSnapshot, seen: EgoState) -> list[SignView]:
        known = eyes.look(snapshot, seen)
        return [view.masked() for view in known] if self._mask else known

    @property
    def told(self) -> tuple[SignDetection, ...]:
        """What imperfect eyes have told so far."""
        return () if self._eyes is None else tuple(self._eyes.told)


def ego_on_map(view: PlannerMap, ego: EgoState) -> EgoState:
    """The ego as planners see it: on lanes of the map."""
    at = view.places[ego.lane] if ego.lane >= 0 else None
    if at is None or at.lane < 0:
        lane, s, d = -1, 0.0, 0.0
    else:
        lane, s, d = at.lane, at.start + at.sign * ego.s, at.sign * ego.d
    return EgoState(
        x=ego.x,
        y=ego.y,
        heading=ego.heading,
        speed=ego.speed,
        acceleration=ego.acceleration,
        steering=ego.steering,
        yaw_rate=ego.yaw_rate,
        lane=lane,
        s=s,
        d=d,
        on_road=ego.on_road,
    )


def destination_on_map(view: PlannerMap, scene: Scene) -> Destination:
    return Destination(*view.on_edge(scene.destination.edge, scene.destination.s))


def _plate(view: PlannerMap, scene: Scene, sign: SignInstance, main_road: tuple[float, ...]) -> SignView:
    """A plate at no distance yet; one beside a road that is not on the map is on no edge."""
    edge, lane, s = "", -1, math.nan
    if sign.edge in view.edges:
        edge, s = view.on_edge(sign.edge, sign.position_m)
        if sign.lane >= 0:
            at = view.place(scene.network.edges[sign.edge].lanes[sign.lane], 0.0)[0]
            lane = view.map.lanes[at].order if at >= 0 else -1
    outline = scene.catalog.sign(sign.code).outline
    return SignView(
        code=sign.code,
        value=sign.value,
        x=sign.x,
        y=sign.y,
        heading=sign.heading,
        edge=edge,
        lane=lane,
        position_m=s,
        distance=math.inf,
        outline=outline,
        main_road=main_road,
        temporary=sign.temporary,
    )


def _lane_id(view: PlannerMap, lane: int) -> str:
    at = view.place(lane, 0.0)[0]
    return view.map.lanes[at].id if at >= 0 else ""
