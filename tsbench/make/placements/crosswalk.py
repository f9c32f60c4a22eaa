"""Crosswalk scenes: people who cross where the ego comes. Source: docs/scenes.md, "Crosswalk".

The network is a corridor with two crossings, each over both directions of the road. A footpath comes up to a crossing
from either side, square to the road, so that lanes keep their numbers and a pedestrian on a footpath means to cross.
Units: m, s, m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree

from tsbench.geometry.polyline import Polyline, join
from tsbench.make.maps.plain import DEFAULT_WIDTH_M, PlainCrossing, PlainEdge, PlainNet, PlainNode, split_edge
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.make.placements.speed_zone import KMH, can_post
from tsbench.make.scenes.recipe import INITIAL_SPEEDS_MPS, Recipe
from tsbench.make.scenes.traffic import walker_elements
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import Lane
from tsbench.roads.road_map import Crossing
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, TARGET
from tsbench.signs.contrast import ContrastClause, PassageParams
from tsbench.signs.rule_kinds import CrosswalkParams, ZoneParams
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart, WalkersPlan
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

SIDES = ("right", "left")
_PATH_SPEED_MPS = 2.78
_BEND_WINDOW_M = 6
_BEND_AFTER_M = 20.0


@dataclass(frozen=True, slots=True)
class _Walker:
    """One pedestrian: from which side, how fast, how far from its kerb it is at first."""

    side: str
    speed: float
    from_kerb: float


class CrosswalkPlacement(ScenePlacement):
    """`crosswalk`: a crossing in the middle of a corridor; people set off so that the first meets the ego there.

    Behind the ego's destination is another one without pedestrians. At each the plates of both directions are alike:
    5.19 at the first and a limit, which slows no vehicle, at the second; in the contrast half they are exchanged.
    """

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road with its crossings and footpaths."""
        edge = next(e for e in plain.edges if e.id == row.fields["edge"])
        other = next((e for e in plain.edges if e.id == row.fields.get("opposite")), None)
        most = int(recipe.number("most_lanes"))
        require(edge.num_lanes <= most, f"{edge.num_lanes} lanes")
        if other is None:
            raise UnfitMapError("no other direction, where the other half's plate faces")
        require(other.num_lanes <= most, "more lanes in the other direction")
        at = recipe.number("ego_before_crossing_m") + recipe.number("start_room_m") + EGO_LENGTH_M
        length = Polyline(edge.shape).length
        second = at + recipe.number("crossings_apart_m")
        require(second <= length - recipe.number("least_after_m"), f"the corridor is {length:.0f} m long")
        return with_crossings(plain, edge, other, (at, second), recipe)

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 90 m before the crossing; the preset by layout, lane and sides drawn."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        first, last, beyond = (f"{row.fields['edge']}.{k}" for k in range(3))
        crossing = next(c for c in network.crossings.values() if first in c.edges)
        lanes = passenger_lanes(network, first)
        lane = lanes[int(task.rng.integers(len(lanes)))]
        ahead = to_crossing(lane, crossing)
        start_s = lane.line.length + ahead - recipe.number("ego_before_crossing_m") - EGO_LENGTH_M / 2
        require(start_s >= EGO_LENGTH_M / 2, f"{lane.line.length:.0f} m of road before the crossing")
        facing = [f"{row.fields['opposite']}.{k}" for k in (1, 0)]
        limit: tuple[str, float | None] = (
            recipe.choices["contrast_plates"][0],
            self._limit(task, (first, last, beyond, *facing)),
        )
        posts = zip((first, facing[0], last, facing[1]), 2 * [(self.code, None)] + 2 * [limit], strict=True)
        signs = tuple(
            plate_beside(
                network,
                code,
                edge,
                network.edge_lanes(edge)[0].line.length,
                None if k else CrosswalkParams(crossing.id, last),
                number=k,
                role=DISTRACTOR if k else TARGET,
                value=value,
            )
            for k, (edge, (code, value)) in enumerate(posts)
        )
        before = {side: _before_strip(crossing, lane, ahead, side) for side in SIDES}
        walkers = self._walkers(task, crossing, before)
        onward = network.lanes[network.outgoing[lane.index][0].to_lane]
        bend = bend_speed(lane, onward, recipe.number("bend_look_m"), recipe.number("bend_lateral_mps2"))
        cruise = round(min(network.shown_limits[lane.index], lane.speed, bend), 2)
        require(cruise >= recipe.number("least_cruise_mps"), f"{cruise:.1f} m/s at the crossing")
        # A fast start makes yielding cost time: an ego that is slow from the start does not slow for pedestrians.
        share = np.interp(variant.initial_speed, INITIAL_SPEEDS_MPS, (recipe.number("start_speed_share"), 1.0))
        start = EgoStart(lane.id, start_s, round(cruise * float(share), 2))
        plan = _plan(task, walkers, lane, ahead, cruise)
        to_line = lane.line.length - start_s - EGO_LENGTH_M / 2
        wait = predicted_arrival(to_line, to_line + ahead, start.speed, cruise, cruise)
        room = network.edge_lanes(last)[0].line.length - recipe.number("end_before_edge_m")
        end_s = variant.route_end(0.0, room)
        return Arrangement(
            signs=signs,
            targets=(signs[0].id,),
            start=start,
            destination=Destination(last, end_s),
            route_hint=(first, last),
            route_length=end_s,
            extra=_elements(task, walkers, crossing, max(wait - plan.lead_time_s, 0.0)),
            walkers=plan,
            blocked=keep_clear(lanes, start),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The plates of the two crossings exchanged; the same people wait until the ego is past.

        The network stays the same: where SUMO's cars let people cross in one half alone, they would tell the plate.
        """
        del task
        first, last = signed.route_hint
        assert signed.walkers is not None
        params = signed.signs[0].params_as(CrosswalkParams)
        passage = PassageParams(first, last, crossing=(params.crossing,))
        others = (*signed.signs[2:], *signed.signs[:2])
        plate, *rest = (
            replace(sign, code=other.code, value=other.value) for sign, other in zip(signed.signs, others, strict=True)
        )
        plate = replace(plate, params=ZoneParams((first, last)))
        walkers = replace(signed.walkers, until_past=True)
        needless = tuple(ContrastClause(name, passage) for name in ("needless_stop", "needless_yield"))
        return replace(signed, signs=(plate, *rest), walkers=walkers, contrast=needless)

    @staticmethod
    def _limit(task: SceneTask, edges: tuple[str, ...]) -> float:
        """The contrast half's limit, km/h: one of the road's class, no less than the road's own and than cars drive."""
        recipe, network = task.recipe, task.network
        driven = [network.expected_speed(edge) for edge in edges]
        driven += [lane.speed for edge in edges for lane in passenger_lanes(network, edge)]
        road = max(driven) / KMH
        code, limits = recipe.choices["contrast_plates"][0], recipe.choices["contrast_kmh"]
        usable = [v for v in limits if can_post(recipe, task.row, code, v) and v >= road - 0.5]
        require(bool(usable), f"no limit of a {task.row.road_class} road is {road:.0f} km/h or more")
        above = [v for v in usable if v >= road + recipe.number("contrast_above_kmh") - 0.5] or usable
        return float(above[task.variant.value % len(above)])

    @staticmethod
    def _walkers(task: SceneTask, crossing: Crossing, before: dict[str, float]) -> list[_Walker]:
        """The preset's people, each so far from its kerb that it steps onto the road a gap after the one before.

        `gap_s`: seconds; or `gap_share`: when the one before has gone that share of the crossing. before: metres from
        each kerb to the ego's strip; the first comes from either side as likely as that is long, within bounds.
        """
        recipe, rng = task.recipe, task.rng
        presets = recipe.choices["presets"]
        preset = presets[task.variant.layout % len(presets)]
        weight = [min(before[s], recipe.number("side_weight_most_m")) for s in SIDES]
        side = int(rng.uniform(0.0, sum(weight)) > weight[0])
        walkers: list[_Walker] = []
        steps_on = 0.0
        for k in range(int(preset["count"])):
            speed = float(rng.uniform(recipe.number("walk_least_mps"), recipe.number("walk_most_mps")))
            if not k:
                steps_on = recipe.number("wait_from_kerb_m") / speed + recipe.number("come_up_s")
            elif "gap_share" in preset:
                steps_on += float(preset["gap_share"]) * crossing.line.length / walkers[-1].speed
            else:
                steps_on += float(preset["gap_s"])
            turn = k if preset["alternate"] else 0
            walkers.append(_Walker(SIDES[(side + turn) % 2], speed, steps_on * speed))
        return walkers


def _before_strip(crossing: Crossing, lane: Lane, ahead: float, side: str) -> float:
    """From the kerb on one side to the strip that the ego sweeps on its lane."""
    middle = lane.line.point_at(lane.line.length + ahead)
    return kerb_to_kerb(crossing, lane, side).project(*middle)[0] - EGO_WIDTH_M / 2


def _plan(task: SceneTask, walkers: list[_Walker], lane: Lane, ahead: float, cruise: float) -> WalkersPlan:
    """When they set off: as the ego's front is at the crossing the first is on the road, too late to react to."""
    return WalkersPlan(
        persons=tuple(f"walker_{k}" for k in range(len(walkers))),
        speeds=tuple(w.speed for w in walkers),
        line_lane=lane.id,
        ego_zone_m=ahead,
        lead_time_s=task.recipe.number("lead_s"),
        ego_cruise_mps=cruise,
        ego_turn_mps=cruise,
        come_up_s=task.recipe.number("come_up_s"),
    )


def _elements(task: SceneTask, walkers: list[_Walker], crossing: Crossing, wait: float) -> tuple[etree._Element, ...]:
    """The people and their types, those beside one another on different tracks of their footpath."""
    recipe, network = task.recipe, task.network
    edge = task.row.fields["edge"]
    size = recipe.number("walker_length_m"), recipe.number("walker_width_m")
    tracks = recipe.choices["tracks_m"]
    elements: list[etree._Element] = []
    for k, w in enumerate(walkers):
        way = (path_name(edge, w.side), path_name(edge, SIDES[w.side == "right"]))
        lane = network.edge_lanes(way[0])[0]
        kerb = kerb_to_kerb(crossing, network.edge_lanes(f"{edge}.0")[0], w.side).points[0]
        reach = math.hypot(*(kerb - lane.line.points[0]))
        require(w.from_kerb <= reach, f"a pedestrian would wait {w.from_kerb:.0f} m from the kerb")
        elements += walker_elements(
            f"walker_{k}", size, w.speed, way, (reach - w.from_kerb, float(tracks[k % len(tracks)])), wait
        )
    return tuple(elements)


def path_name(edge: str, side: str, number: int = 0) -> str:
    """Id of the footpath on one side of a corridor's edge at its first or second crossing."""
    return f"{edge}.path{number}_{side}"


def with_crossings(
    plain: PlainNet, edge: PlainEdge, other: PlainEdge, at: tuple[float, float], recipe: Recipe
) -> PlainNet:
    """The road cut at two places along `edge`, and there crossed; `other`: the edge of the opposite direction."""
    line, across = Polyline(edge.shape), Polyline(other.shape)
    net, parts = split_edge(plain, edge.id, at)
    places = [line.point_at(s) for s in at]
    facing = [across.project(*place) for place in places]
    net, theirs = split_edge(net, other.id, (facing[1][0], facing[0][0]))
    half = edge.num_lanes * _width(edge) / (2.0 if edge.spread == "center" else 1.0)
    share = 2.0 if other.spread == "center" else 1.0
    for k, (x, y) in enumerate(places):
        node = f"{edge.id}.cut{k + 1}"
        net = _joined(net, f"{other.id}.cut{2 - k}", node)
        beyond = abs(facing[k][1]) + other.num_lanes * _width(other) / share
        reach = {"right": half, "left": max(beyond, half if edge.spread == "center" else 0.0)}
        heading = line.heading_at(at[k])
        nodes, paths = [], []
        for side, turn in (("right", -math.pi / 2), ("left", math.pi / 2)):
            far = reach[side] + recipe.number("path_m")
            name = path_name(edge.id, side, k)
            end = PlainNode(f"{name}.end", x + far * math.cos(heading + turn), y + far * math.sin(heading + turn))
            nodes.append(end)
            paths.append(
                PlainEdge(
                    name, end.id, node, 1, _PATH_SPEED_MPS, 1, ((end.x, end.y), (x, y)),
                    width=recipe.number("path_width_m"), spread="center", allow="pedestrian",
                )
            )  # fmt: skip
        crossing = PlainCrossing(node, (parts[k], theirs[2 - k]), recipe.number("crossing_width_m"))
        net = replace(net, nodes=(*net.nodes, *nodes), edges=(*net.edges, *paths), crossings=(*net.crossings, crossing))
    return net


def _width(edge: PlainEdge) -> float:
    return DEFAULT_WIDTH_M if edge.width is None else edge.width


def _joined(net: PlainNet, old: str, new: str) -> PlainNet:
    """The network with one node in place of two."""
    edges = tuple(
        replace(e, source=new if e.source == old else e.source, target=new if e.target == old else e.target)
        for e in net.edges
    )
    return replace(net, nodes=tuple(n for n in net.nodes if n.id != old), edges=edges)


def to_crossing(lane: Lane, crossing: Crossing) -> float:
    """From the end of a lane on to the near edge of the crossing behind it."""
    end = lane.line.point_at(lane.line.length)
    middle = crossing.line.point_at(crossing.line.project(*end)[0])
    return lane.line.project(*middle)[0] - lane.line.length - crossing.width / 2


def bend_speed(lane: Lane, onward: Lane, look_m: float, lateral: float) -> float:
    """What the bends allow in the last `look_m` m of a lane and the first of the next, at `lateral` m/s2, in m/s."""
    line = join([lane.line, onward.line])
    at = np.arange(max(lane.line.length - look_m, 0.0), lane.line.length + _BEND_AFTER_M, 1.0)
    heading = np.unwrap([line.heading_at(float(s)) for s in at])
    turn = np.abs(heading[_BEND_WINDOW_M:] - heading[:-_BEND_WINDOW_M]).max() / _BEND_WINDOW_M
    return math.sqrt(lateral / max(float(turn), 1e-4))


def kerb_to_kerb(crossing: Crossing, lane: Lane, side: str) -> Polyline:
    """The middle line of a crossing from the kerb on one side of the lane that leads up to it."""
    points = crossing.line.points
    right_first = lane.line.project(*points[0])[1] < lane.line.project(*points[-1])[1]
    return crossing.line if right_first == (side == "right") else Polyline(points[::-1])
