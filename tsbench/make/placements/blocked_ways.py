"""Scenes in which the ego's way is blocked: by an obstacle on its lane, or by 3.2 in the exit that navigation names.

The obstacle is to be passed on a side that its plate allows; 3.2 may close another exit, too.
Source: docs/scenes.md, "Detours", "Closed road". Units: m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

from tsbench.geometry.elementary import LEFT, U_TURN
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.junction_priority import through_arms, with_priorities
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    before_line,
    exchanged,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
    turns_into,
    usual_limit,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.traffic import BODIES
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, SignInstance
from tsbench.signs.contrast import ContrastClause, PassageParams, WayParams
from tsbench.signs.rule_kinds import ApproachParams, ObstacleParams
from tsbench.sim.scene import EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M

# The front of a car that stands behind an obstacle is at least so far past its end.
_LONGEST_CAR_M = max(length for length, _ in BODIES.values())
# From layout to layout, so that they differ in approach, exit and closed exit; prime to the usual numbers of ways.
_STRIDE = 7


class DetourPlacement(ScenePlacement):
    """`detour_*`: an obstacle on a lane with one on each side; in the contrast half it is passed on the other.

    Where there is a contrast half, a second obstacle on the same lane lies behind the ego and has the other plate; the
    halves exchange the two. No other vehicle drives in this direction, because none could keep all four plates.
    """

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The road stays as it is: other traffic sees the obstacle itself."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        return plain

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the obstacle, in its lane."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        edge = row.fields["edge"]
        lanes = passenger_lanes(network, edge)
        require(len(lanes) >= recipe.number("least_lanes"), f"{len(lanes)} lanes for cars")
        between = lanes[1:-1]
        lane = between[variant.layout // 2 % len(between)]
        shapes = recipe.choices["obstacles"]
        shape = shapes[variant.layout % len(shapes)]
        length = float(shape["length_m"])
        ahead = recipe.number("ego_before_obstacle_m")
        length_m = lane.line.length
        latest = length_m - recipe.number("least_after_m") - length
        front = EGO_LENGTH_M + recipe.number("start_room_m")
        front += float(task.rng.uniform(0.0, recipe.number("jitter_m")))
        near = min(front + ahead + 0.5 * EGO_LENGTH_M, latest)
        start_s = near - ahead - EGO_LENGTH_M / 2
        require(start_s >= EGO_LENGTH_M / 2, f"the corridor is {length_m:.0f} m long")
        middle = near + length / 2
        signs = [_plate(0, self.code, lane, near, "target", ObstacleParams("obstacle_0"))]
        obstacles = [_obstacle(0, shape, lane, near)]
        if self._others(recipe):
            passed = recipe.number("passed_after_edge_m")
            room = start_s - EGO_LENGTH_M / 2 - passed - length
            require(room >= recipe.number("passed_before_ego_m"), f"{room:.0f} m behind the obstacle passed")
            signs.append(_plate(1, self._others(recipe)[0], lane, passed, DISTRACTOR))
            obstacles.append(_obstacle(1, shape, lane, passed))
        past = recipe.number("end_before_edge_m")
        end_s = middle + variant.route_end(recipe.number("least_after_m") - past, length_m - past - middle)
        beyond = near + length + _LONGEST_CAR_M + 1.0
        return Arrangement(
            signs=tuple(signs),
            targets=(signs[0].id,),
            start=EgoStart(lane.id, start_s, start_speed(task, lane)),
            destination=Destination(edge, end_s),
            route_hint=(edge,),
            route_length=end_s - middle,
            obstacles=tuple(obstacles),
            blocked=((lane.id, start_s, beyond),),
            closed_edges=frozenset((edge,) if len(obstacles) > 1 else ()),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The two plates exchanged; where the target allows both sides, no plate contradicts it."""
        if not self._others(task.recipe):
            return None
        first, second = signed.signs
        return replace(signed, signs=(replace(first, code=second.code), replace(second, code=first.code)))

    @staticmethod
    def _others(recipe: Recipe) -> list[str]:
        """Plates of the contrast half."""
        return recipe.choices.get("contrast_plates", [])


def _obstacle(number: int, shape: dict[str, Any], lane: Lane, near: float) -> Obstacle:
    """An obstacle of the recipe's shape on a lane, its near end at `near`."""
    length, width = float(shape["length_m"]), float(shape["width_m"])
    x, y = lane.line.point_at(near + length / 2)
    heading = lane.line.heading_at(near + length / 2)
    return Obstacle(f"obstacle_{number}", str(shape["shape"]), x, y, heading, length, width, lane.id)


def _plate(
    number: int, code: str, lane: Lane, s: float, role: str, params: ObstacleParams | None = None
) -> SignInstance:
    """The plate on an obstacle's near end."""
    x, y = lane.line.point_at(s)
    return SignInstance(
        id=f"sign_{number}", code=code, value=None, edge=lane.edge, lane=lane.order, position_m=s, x=x, y=y,
        heading=lane.line.heading_at(s), role=role, params=params,
    )  # fmt: skip


@dataclass(frozen=True)
class _Way:
    """Into the closed exit: the ego's lane on its approach, the exit edge, and the other half's closed exit.

    back: the edges that come out of the two.
    """

    lane: Lane
    exit: str
    other: str
    back: tuple[str, str]


class ClosedRoadPlacement(ScenePlacement):
    """`blocked_road`: the ego comes on the main road, so that it is the plate that stops it and not the traffic.

    A second post stands at the mouth of another exit; in the contrast half 3.2 hangs there. No vehicle uses
    either road.
    """

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The through pair has priority; other traffic learns of the closure from its routes and the barriers."""
        return with_priorities(row, plain, through_arms(row, 0.0), recipe, minor_stops=False)

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the junction; the plate 10 m into the exit, the destination behind."""
        network, graph, recipe, variant = task.network, task.graph, task.recipe, task.variant
        ways = _ways(task.row, network, graph, recipe)
        if not ways:
            raise UnfitMapError("no way from the main road into an exit that could be closed")
        way = ways[variant.layout * _STRIDE % len(ways)]
        lane = way.lane
        start = EgoStart(lane.id, before_line(lane, recipe.number("ego_before_line_m")), start_speed(task, lane))
        plate_s = recipe.number("plate_after_junction_m")
        harmless = recipe.choices["harmless"][0]
        signs = (
            plate_beside(network, self.code, way.exit, plate_s, ApproachParams(lane.edge)),
            usual_limit(task, harmless, (way.other, plate_s), (way.exit, way.other)),
        )
        room = network.edges[way.exit].length - recipe.number("end_before_edge_m")
        end_s = variant.route_end(plate_s + recipe.number("destination_behind_plate_m"), room)
        into = turns_into(graph, {way.exit, way.other})
        return Arrangement(
            signs=signs,
            targets=(signs[0].id,),
            start=start,
            destination=Destination(way.exit, end_s),
            route_hint=(lane.edge, way.exit),
            route_length=end_s,
            avoid_turns=frozenset(into),
            closed_edges=frozenset({way.exit, way.other, *way.back}),
            platoons=frozenset(network.edges),
            blocked=keep_clear(passenger_lanes(network, lane.edge), start),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The two plates exchanged: the ego's way is open."""
        plate, other = signed.signs
        approach, exit_ = signed.route_hint
        # Left turns wait for oncoming traffic.
        left = task.graph.turn(approach, exit_) == LEFT
        oncoming = tuple(e for e in through_arms(task.row, 0.0).prior_in if left and e != approach)
        passage = PassageParams(approach, exit_, oncoming)
        needless = (
            ContrastClause("needless_stop", passage),
            ContrastClause("needless_detour", WayParams(approach, exits=(exit_,))),
        )
        return replace(signed, targets=(other.id,), signs=exchanged(plate, other), contrast=needless)


def _ways(row: PoolRow, network: RoadNetwork, graph: LaneGraph, recipe: Recipe) -> list[_Way]:
    """Ways from the main road into each exit that is long enough and that others need not take."""
    approach_m, least = recipe.number("ego_before_line_m"), recipe.number("least_exit_m")
    back = {
        a["out_edge"]: a["in_edge"]
        for a in row.fields["arms"]
        if a["out_edge"] in network.edges and a["in_edge"] in network.edges
    }
    entries = [a["in_edge"] for a in row.fields["arms"] if a["in_edge"] in network.edges]
    room = {e for e in back if network.edges[e].length >= least}
    found = []
    for approach in through_arms(row, 0.0).prior_in:
        if approach not in network.edges or network.edges[approach].length < approach_m + 5.0:
            continue
        ahead = [e for e in graph.successors(approach) if e in room and graph.turn(approach, e) != U_TURN]
        for target, other in permutations(ahead, 2):
            used = [e for e in entries if e not in (back[target], back[other])]
            if graph.route(approach, target) == (approach, target) and all(
                set(graph.successors(e)) - {target, other} for e in used
            ):
                lanes = dict.fromkeys(c.from_lane for c in graph.connections(approach, target))
                ends = back[target], back[other]
                found += [_Way(network.lanes[i], target, other, ends) for i in lanes]
    return found
