"""Closed-road scenes: navigation leads into an exit that 3.2 closes, or closes for those who come out of it.

Source: docs/scenes.md, "Closed road". Units: m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.placements.junction_arms import through_arms, with_priorities
from tsbench.dataset.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    before_line,
    keep_clear,
    passenger_lanes,
    plate_beside,
    start_speed,
    usual_limit,
)
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.geometry.angles import LEFT, U_TURN
from tsbench.roads.destination import Destination
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR
from tsbench.signs.contrast import ContrastClause, PassageParams, WayParams
from tsbench.signs.plate_params import ApproachParams
from tsbench.sim.scene import EgoStart


@dataclass(frozen=True)
class _Way:
    """Into the closed exit: the ego's lane on its approach, the exit edge, and the edge that comes out of it."""

    lane: Lane
    exit: str
    back: str


class ClosedRoadPlacement(ScenePlacement):
    """`blocked_road`: the ego comes on the main road, so that it is the plate that stops it and not the traffic.

    A second post faces who comes out of the exit; in the contrast half 3.2 hangs there, and binds them.
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
        way = ways[variant.layout % len(ways)]
        lane = way.lane
        start = EgoStart(
            lane.id,
            before_line(lane, recipe.number("ego_before_line_m")),
            start_speed(task, lane),
        )
        plate_s = recipe.number("plate_after_junction_m")
        back_s = network.edge_lanes(way.back)[0].line.length - plate_s
        harmless = recipe.choices["harmless"][0]
        signs = (
            plate_beside(network, self.code, way.exit, plate_s, ApproachParams(lane.edge)),
            usual_limit(network, harmless, (way.back, back_s), (way.exit, way.back)),
        )
        end_s = plate_s + recipe.number("destination_behind_plate_m")
        into = {(e, way.exit) for e in network.edges if way.exit in graph.successors(e)}
        return Arrangement(
            signs=signs, target=signs[0].id, start=start, destination=Destination(way.exit, end_s),
            route_hint=(lane.edge, way.exit), route_length=end_s, avoid_turns=frozenset(into),
            closed_edges=frozenset({way.exit, way.back}), platoons=frozenset(network.edges),
            blocked=keep_clear(passenger_lanes(network, lane.edge), start),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The two plates exchanged: nobody may come from there, and the ego drives on."""
        plate, other = signed.signs
        approach, exit_ = signed.route_hint
        # Who turns left waits for who comes towards it.
        left = task.graph.turn(approach, exit_) == LEFT
        oncoming = tuple(e for e in through_arms(task.row, 0.0).prior_in if left and e != approach)
        passage = PassageParams(approach, exit_, oncoming)
        return replace(
            signed, target=other.id,
            signs=(
                replace(plate, code=other.code, value=other.value, role=DISTRACTOR, params=None),
                replace(other, code=plate.code, value=None, role="target"),
            ),
            contrast=(
                ContrastClause("needless_stop", passage),
                ContrastClause("needless_detour", WayParams(approach, exits=(exit_,))),
            ),
        )  # fmt: skip


def _ways(row: PoolRow, network: RoadNetwork, graph: LaneGraph, recipe: Recipe) -> list[_Way]:
    """Ways from the main road into each exit that is long enough and that others need not take."""
    approach_m = recipe.number("ego_before_line_m")
    least = recipe.number("least_exit_m")
    back = {
        a["out_edge"]: a["in_edge"]
        for a in row.fields["arms"]
        if a["out_edge"] and a["in_edge"] in network.edges
    }
    entries = [a["in_edge"] for a in row.fields["arms"] if a["in_edge"] in network.edges]
    found = []
    for approach in through_arms(row, 0.0).prior_in:
        if approach not in network.edges or network.edges[approach].length < approach_m + 5.0:
            continue
        for target in graph.successors(approach):
            if graph.turn(approach, target) == U_TURN or network.edges[target].length < least:
                continue
            if graph.route(approach, target) != (approach, target) or target not in back:
                continue
            others = [e for e in entries if e != back[target]]
            if all(set(graph.successors(e)) - {target} for e in others):
                lanes = dict.fromkeys(c.from_lane for c in graph.connections(approach, target))
                found += [_Way(network.lanes[i], target, back[target]) for i in lanes]
    return found
