"""Dual-path scenes: the short way is prohibited by one plate, a longer one is open. Source: docs/spec/scenes.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.placements.base import (
    Arrangement,
    SceneTask,
    UnfitMapError,
    before_line,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
)
from tsbench.dataset.placements.obedient_way import (
    check_way,
    drive_time,
    main_road,
    sharpest_bend,
    turn_between,
    waits,
)
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.geometry.angles import LEFT, RIGHT, SUMO_TURNS
from tsbench.roads.destination import Destination
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.signs.plate_params import JunctionParams
from tsbench.sim.scene import EgoStart


class ManoeuvrePlacement:
    """One plate on the approach; navigation leads through a manoeuvre that it prohibits."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]
        self.allowed = load_catalog().sign(self.code).rule.options.get("allowed", ())

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The roads stay; the obedient way becomes the main road. Other traffic is routed as the plate says."""
        ways = (row.fields["signed_edge"], *row.fields["compliant"])
        seconds = drive_time(plain, ways, recipe)
        require(seconds <= recipe.number("longest_drive_s"), f"the obedient way takes about {seconds:.0f} s")
        bend = max(sharpest_bend(e) for e in plain.edges if e.id in ways)
        require(
            bend <= recipe.number("sharpest_bend_deg"),
            f"the obedient way bends by {bend:.0f} degrees in a road",
        )
        return main_road(plain, ways, int(recipe.number("main_priority")))

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 40 to 60 m before the signed junction, in a lane that leads into the prohibited manoeuvre."""
        network, graph, recipe, variant = task.network, task.graph, task.recipe, task.variant
        signed, target = task.row.fields["signed_edge"], task.row.fields["destination_edge"]
        for edge in (signed, target):
            require(edge in network.edges, f"edge {edge} is gone in the finished network")
        short = graph.route(signed, target)
        require(short is not None and len(short) > 2, "no way to the destination")
        assert short is not None
        banned = self.banned(graph, short)
        closed = self.closed(graph, short)
        compliant = graph.route(signed, target, banned, closed)
        require(compliant is not None, "no way round the prohibited manoeuvre")
        assert compliant is not None
        _check_turns(task.row, graph, short, compliant)
        check_way(graph, compliant)
        options = [network.lanes[c.from_lane] for c in graph.connections(short[0], short[1])]
        lane = options[variant.layout % len(options)]
        before = float(task.rng.uniform(recipe.number("ego_nearest_m"), recipe.number("ego_farthest_m")))
        start = EgoStart(lane.id, before_line(lane, before), min(variant.initial_speed, lane.speed))
        goal = network.edge_lanes(target)[0].line.length
        end_s = min(recipe.number("destination_m"), goal - recipe.number("end_before_edge_m"))
        require(end_s >= recipe.number("least_destination_m"), f"the destination edge is {goal:.0f} m long")
        sign = self.plate(task, short)
        return Arrangement(
            signs=(sign,), target=sign.id, start=start, destination=Destination(target, end_s), route_hint=short,
            compliant_hint=compliant, route_length=_length(network, graph, short[1:]),
            avoid_turns=_avoided(graph, compliant, banned, closed), closed_edges=closed,
            platoons=frozenset(network.edges), blocked=keep_clear(passenger_lanes(network, signed), start),
        )  # fmt: skip

    def banned(self, graph: LaneGraph, short: Sequence[str]) -> frozenset[Turn]:
        """Turns out of the signed approach that nobody makes."""
        return frozenset(
            (short[0], exit_)
            for exit_ in graph.successors(short[0])
            if graph.turn(short[0], exit_) not in self.allowed
        )

    def closed(self, graph: LaneGraph, short: Sequence[str]) -> frozenset[str]:
        """Edges that nobody enters, wherever from."""
        del graph, short
        return frozenset()

    def plate(self, task: SceneTask, short: Sequence[str]) -> SignInstance:
        """The target's plate: on the approach, for all its lanes."""
        lane = task.network.edge_lanes(short[0])[0]
        params = JunctionParams(short[0], task.row.fields["junction"])
        at = lane.line.length - task.recipe.number("plate_before_line_m")
        return plate_beside(task.network, self.code, short[0], at, params)


class OneWayPlacement(ManoeuvrePlacement):
    """5.7.x: the crossing road runs one way. What contradicts the plate is taken out, or closed to others.

    The arm that may be entered loses its lanes towards the junction. The lanes of the other arm that lead away
    from it stay, because navigation leads into them, but no other car uses them.
    """

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.way = RIGHT if RIGHT in self.allowed else LEFT

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The crop without the lanes that come from where the one-way road leads to."""
        plain = super().prepare(row, plain, recipe)
        signed, junction = row.fields["signed_edge"], row.fields["junction"]
        approach = next(e for e in plain.edges if e.id == signed)
        exits = [e for e in plain.edges if e.source == junction]
        require(
            any(turn_between(approach, e) == self.way for e in exits),
            "the crossing road does not go on where the plate points",
        )
        # An edge into the junction belongs to the arm that the reversed edge would leave by.
        gone = {
            e.id
            for e in plain.edges
            if e.target == junction
            and e.id not in (signed, *row.fields["short"], *row.fields["compliant"])
            and turn_between(approach, replace(e, shape=e.shape[::-1])) == self.way
        }
        return replace(
            plain,
            edges=tuple(e for e in plain.edges if e.id not in gone),
            connections=tuple(c for c in plain.connections if not {c.source, c.target} & gone),
        )

    def closed(self, graph: LaneGraph, short: Sequence[str]) -> frozenset[str]:
        """The exits against the one-way road."""
        return frozenset(e for _, e in self.banned(graph, short))


class NoEntryPlacement(ManoeuvrePlacement):
    """3.1 on the exit edge that navigation leads into; nobody enters it from anywhere."""

    def banned(self, graph: LaneGraph, short: Sequence[str]) -> frozenset[Turn]:
        """What binds is the edge, not the turn."""
        del graph, short
        return frozenset()

    def closed(self, graph: LaneGraph, short: Sequence[str]) -> frozenset[str]:
        """The signed edge."""
        del graph
        return frozenset({short[1]})

    def plate(self, task: SceneTask, short: Sequence[str]) -> SignInstance:
        """The plate a few metres into the closed edge, facing who would enter it."""
        at = task.recipe.number("plate_after_start_m")
        length = task.network.edge_lanes(short[1])[0].line.length
        require(length >= 2.0 * at, f"the closed edge is {length:.0f} m long")
        return plate_beside(task.network, self.code, short[1], at)


def _avoided(
    graph: LaneGraph, compliant: Sequence[str], banned: frozenset[Turn], closed: frozenset[str]
) -> frozenset[Turn]:
    """Turns that other cars leave alone: prohibited ones, those into closed edges, and on the obedient way, where
    there is another, those for which they would have to wait: the ego would queue behind them until the time is over.
    """
    into = {(edge, e) for e in closed for edge in graph.network.edges if e in graph.successors(edge)}
    avoided = banned | into
    for edge in compliant[:-1]:
        turns = {(edge, e) for e in graph.successors(edge)} - avoided
        waiting = {t for t in turns if waits(graph, *t)}
        avoided |= waiting if waiting != turns else set()
    return avoided


def _check_turns(row: PoolRow, graph: LaneGraph, short: Sequence[str], compliant: Sequence[str]) -> None:
    """The ways go as the slot says, and SUMO calls every exit what the rule calls it."""
    for route, letter in ((short, row.slot[0]), (compliant, row.slot[2])):
        turn = graph.turn(route[0], route[1])
        if turn[0] != letter:
            raise UnfitMapError(f"slot {row.slot}, but the way over {route[1]} goes {turn}")
    for exit_ in graph.successors(short[0]):
        turn = graph.turn(short[0], exit_)
        for c in graph.connections(short[0], exit_):
            if SUMO_TURNS.get(c.direction) != turn:
                raise UnfitMapError(
                    f"SUMO calls the turn into {exit_} {c.direction!r}, by its angle it is {turn}"
                )


def _length(network: RoadNetwork, graph: LaneGraph, edges: Sequence[str]) -> float:
    inner = sum(graph.crossing_length(a, b) for a, b in pairwise(edges))
    return inner + sum(network.edges[e].length for e in edges)
