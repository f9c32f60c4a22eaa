"""Dual-path scenes: the short way is prohibited by one plate, a longer one is open. Source: spec/scenes.md."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from tsbench.geometry.polyline import Polyline
from tsbench.maps.network import RoadNetwork
from tsbench.maps.plain import PlainNet
from tsbench.maps.pool import PoolRow
from tsbench.scenarios.families.base import (
    Arrangement,
    SceneTask,
    UnfitMapError,
    before_line,
    beside_road,
    passenger_lanes,
    require,
    way_ahead,
)
from tsbench.scenarios.recipe import Recipe
from tsbench.signs.annotations import SignInstance
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.scene import Destination, EgoStart

_SLOT_WORDS = {"s": "straight", "l": "left", "r": "right"}


def drive_time(network: RoadNetwork, graph: LaneGraph, edges: Sequence[str], recipe: Recipe) -> float:
    """A rough driving time (s): lengths by limits or by the speed of traffic, and a few seconds for each turn."""
    pace = recipe.number("traffic_mps")
    time = sum(network.edges[e].length / min(network.edge_lanes(e)[0].speed, pace) for e in edges)
    return time + recipe.number("turn_s") * sum(graph.turn(a, b) != "straight" for a, b in pairwise(edges))


class ManoeuvrePlacement:
    """One plate on the approach; navigation leads through the manoeuvre that it prohibits."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The roads stay as they are: other traffic is routed as the plate says."""
        way = float(row.fields["compliant_m"])
        require(way <= recipe.number("longest_way_m"), f"the obedient way is {way:.0f} m long")
        edges = {e.id: e for e in plain.edges}
        pace = recipe.number("traffic_mps")
        known = [edges[e] for e in row.fields["compliant"] if e in edges]
        seconds = sum(Polyline(e.shape).length / min(e.speed, pace) for e in known)
        # Checked again on the finished network; this spares building most of those that are too long.
        require(seconds <= recipe.number("longest_drive_s"), f"the obedient way takes about {seconds:.0f} s")
        return plain

    def arrange(self, task: SceneTask) -> Arrangement:
        """The ego 40 to 60 m before the signed junction, in a lane that leads into the prohibited manoeuvre."""
        row, network, graph, recipe, variant = task.row, task.network, task.graph, task.recipe, task.variant
        fields = row.fields
        signed, target, junction = fields["signed_edge"], fields["destination_edge"], fields["junction"]
        for edge in (signed, target):
            require(edge in network.edges, f"edge {edge} is gone in the finished network")
        short = graph.route(signed, target)
        require(short is not None and len(short) > 1, "no way to the destination")
        assert short is not None
        banned = (short[0], short[1])
        compliant = graph.route(signed, target, avoid_turns={banned})
        require(compliant is not None, "no way round the prohibited manoeuvre")
        assert compliant is not None
        self._check_slot(row, graph, short, compliant)
        seconds = drive_time(network, graph, compliant, recipe)
        require(seconds <= recipe.number("longest_drive_s"), f"the obedient way takes about {seconds:.0f} s")
        options = [network.lanes[c.from_lane] for c in graph.connections(*banned)]
        lane = options[variant.layout % len(options)]
        before = float(task.rng.uniform(recipe.number("ego_nearest_m"), recipe.number("ego_farthest_m")))
        start = EgoStart(lane.id, before_line(lane, before), min(variant.initial_speed, lane.speed))
        goal = network.edge_lanes(target)[0].line.length
        end_s = min(recipe.number("destination_m"), goal - recipe.number("end_before_edge_m"))
        require(end_s >= recipe.number("least_destination_m"), f"the destination edge is {goal:.0f} m long")
        plate_s = lane.line.length - recipe.number("plate_before_line_m")
        x, y, heading = beside_road(network, signed, plate_s)
        sign = SignInstance(
            id="sign_0", code=self.code, value=None, edge=signed, lane=-1, position_m=plate_s, x=x, y=y,
            heading=heading, role="target", params={"junction": junction, "approach": signed},
        )  # fmt: skip
        return Arrangement(
            signs=(sign,), target=sign.id, start=start, destination=Destination(target, end_s), route_hint=short,
            compliant_hint=compliant, route_length=_length(network, graph, short[1:]), avoid_turns=frozenset({banned}),
            platoons=frozenset(network.edges), blocked=way_ahead(passenger_lanes(network, signed), start),
        )  # fmt: skip

    @staticmethod
    def _check_slot(row: PoolRow, graph: LaneGraph, short: Sequence[str], compliant: Sequence[str]) -> None:
        for route, letter in ((short, row.slot[0]), (compliant, row.slot[2])):
            turn = graph.turn(route[0], route[1])
            if turn != _SLOT_WORDS[letter]:
                raise UnfitMapError(f"slot {row.slot}, but the way over {route[1]} goes {turn}")


def _length(network: RoadNetwork, graph: LaneGraph, edges: Sequence[str]) -> float:
    inner = sum(graph.crossing_length(a, b) for a, b in pairwise(edges))
    return inner + sum(network.edges[e].length for e in edges)
