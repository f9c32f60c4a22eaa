"""Closed-road scenes: navigation leads into an exit that 3.2 closes, or 3.2 closes another exit.

Source: docs/scenes.md, "Closed road". Units: m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

from tsbench.geometry.angles import LEFT, U_TURN
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.junction_arms import through_arms, with_priorities
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
    start_speed,
    turns_into,
    usual_limit,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.contrast import ContrastClause, PassageParams, WayParams
from tsbench.signs.plate_params import ApproachParams
from tsbench.sim.scene import EgoStart

# From layout to layout, so that they differ in approach, exit and closed exit; prime to the usual numbers of ways.
_STRIDE = 7


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

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

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
            target=signs[0].id,
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
        return replace(signed, target=other.id, signs=exchanged(plate, other), contrast=needless)


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
