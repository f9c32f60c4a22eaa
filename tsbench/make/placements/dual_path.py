"""Dual-path scenes: the short way is prohibited by one plate, a longer one is open. Source: docs/scenes.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from tsbench.geometry.elementary import LEFT, RIGHT, SUMO_TURNS
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.obedient_way import (
    check_way,
    drive_time,
    grazing_turns,
    main_road,
    sharpest_bend,
    turn_between,
    waits,
)
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
from tsbench.make.scenes.plate_checks import refused
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.make.scenes.plate_surroundings import PlacedPlates
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import Destination, LaneGraph, Turn
from tsbench.roads.network import RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import SignInstance
from tsbench.signs.contrast import ContrastClause, WayParams
from tsbench.signs.rule_kinds import JunctionParams
from tsbench.sim.scene import EgoStart


class ManoeuvrePlacement(ScenePlacement):
    """One plate on the approach; navigation leads through a manoeuvre that it prohibits.

    In the contrast half the plate there permits this manoeuvre and prohibits that of the other way. Traffic on either
    way goes first, and no vehicle does what either plate prohibits, so that traffic does not give the plate away.
    """

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe)
        self.catalog = recipe.catalog
        self.allowed = self._allowed(self.code)
        rules = {"manoeuvre", "one_way_exit"}
        self._family = [c for c, sign in self.catalog.signs.items() if sign.rule.name in rules and not sign.is_end]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The roads stay; traffic on either way goes first. Other traffic is routed as the plates say."""
        ways = (row.fields["signed_edge"], *row.fields["compliant"])
        seconds = drive_time(plain, ways, recipe)
        require(seconds <= recipe.number("longest_drive_s"), f"the obedient way takes about {seconds:.0f} s")
        block = row.fields["short_m"] + row.fields["compliant_m"]
        require(block >= recipe.number("least_block_m"), f"the two ways have {block:.0f} m in all: a slip lane")
        bend = max(sharpest_bend(e) for e in plain.edges if e.id in ways)
        require(bend <= recipe.number("sharpest_bend_deg"), f"the obedient way bends by {bend:.0f} degrees in a road")
        both = (*ways, *row.fields["short"])
        return main_road(self.roads(row, plain), both, int(recipe.number("main_priority")))

    def roads(self, row: PoolRow, plain: PlainNet) -> PlainNet:
        """The crop as both halves have it."""
        del row
        return plain

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 40 to 60 m before the signed junction, in a lane that leads into the prohibited manoeuvre."""
        network, graph, recipe, variant = task.network, task.graph, task.recipe, task.variant
        signed, target = task.row.fields["signed_edge"], task.row.fields["destination_edge"]
        for edge in (signed, target):
            require(edge in network.edges, f"edge {edge} is gone in the finished network")
        short = graph.route(signed, target)
        require(short is not None and len(short) > 2, "no way to the destination")
        assert short is not None
        banned, closed = self.banned(graph, short, self.allowed), self.closed(graph, short)
        compliant = graph.route(signed, target, banned, closed)
        require(compliant is not None, "no way round the prohibited manoeuvre")
        assert compliant is not None
        _check_turns(task.row, graph, short, compliant)
        wide, *ways = (len(passenger_lanes(network, edge)) for edge in (signed, short[1], compliant[1]))
        require(wide <= min(ways), f"a plate would send {wide} lanes of a road into one of {min(ways)}")
        options = [network.lanes[c.from_lane] for c in graph.connections(short[0], short[1])]
        lane = options[variant.layout % len(options)]
        before = float(task.rng.uniform(recipe.number("ego_nearest_m"), recipe.number("ego_farthest_m")))
        start = EgoStart(lane.id, before_line(lane, before), start_speed(task, lane))
        goal = network.edge_lanes(target)[0].line.length
        room = min(recipe.number("destination_m"), goal - recipe.number("end_before_edge_m"))
        least = recipe.number("least_destination_m")
        require(room >= least, f"the destination edge is {goal:.0f} m long")
        end_s = variant.route_end(least, room)
        plates, other = self.plates(task, short, compliant), self.other_code(task, short, compliant)
        for half in (plates, self.other_plates(plates, other)):
            scene = PlacedPlates(self.catalog, plate_roads(graph, self.catalog.distances), half, (), ())
            for plate in half:
                for _, why in refused(scene, plate):
                    raise UnfitMapError(f"plate {plate.code} {why}")
        banned |= self.banned(graph, short, self._allowed(other))
        closed |= self.closed(graph, compliant) | self.empty(task, signed)
        grazing = grazing_turns(graph, short) | grazing_turns(graph, compliant)
        closed |= _left_alone(graph, grazing) - {*short, *compliant}
        avoided = _avoided(graph, (short, compliant), banned | grazing, closed)
        for way in (short, compliant):
            check_way(graph, way, avoided)
        return Arrangement(
            signs=plates, targets=(plates[0].id,), start=start, destination=Destination(target, end_s),
            route_hint=short, compliant_hint=compliant, route_length=_length(network, graph, short[1:]) + end_s,
            avoid_turns=avoided, closed_edges=closed,
            quiet_edges=frozenset({signed}), platoons=frozenset(network.edges),
            blocked=keep_clear(passenger_lanes(network, signed), start),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The navigation's way, permitted."""
        short, compliant = signed.route_hint, signed.compliant_hint
        code = self.other_code(task, short, compliant)
        plates = self.other_plates(signed.signs, code)
        target = next(p.id for p in plates if p.role == "target")
        way = ContrastClause("needless_detour", WayParams(short[0], exits=(short[1],)))
        return replace(signed, signs=plates, targets=(target,), compliant_hint=(), contrast=(way,))

    def banned(self, graph: LaneGraph, short: Sequence[str], allowed: Sequence[str]) -> frozenset[Turn]:
        """Turns out of the signed approach that a plate with these manoeuvres prohibits."""
        return frozenset(
            (short[0], exit_) for exit_ in graph.successors(short[0]) if graph.turn(short[0], exit_) not in allowed
        )

    def closed(self, graph: LaneGraph, way: Sequence[str]) -> frozenset[str]:
        """Edges that no vehicle enters, wherever from, where `way` is prohibited."""
        del graph, way
        return frozenset()

    def empty(self, task: SceneTask, approach: str) -> frozenset[str]:
        """Edges that no other vehicle uses in either half."""
        del task, approach
        return frozenset()

    def other_code(self, task: SceneTask, short: Sequence[str], compliant: Sequence[str]) -> str:
        """A plate that can stand there, permits the navigation's manoeuvre and prohibits the other way's.

        It shows no exit in vain. Where some permit a manoeuvre that the target permits too, it is drawn among these:
        where both hang again, other traffic then has a way on in both halves.
        """
        graph, approach = task.graph, short[0]
        wanted, other = (graph.turn(way[0], way[1]) for way in (short, compliant))
        roads = plate_roads(graph, self.catalog.distances)
        scene = PlacedPlates(self.catalog, roads, (), (), ())
        at = roads.length(approach) - task.recipe.number("plate_before_line_m")
        fit = [
            code
            for code in self._family
            if wanted in self._allowed(code)
            and other not in self._allowed(code)
            and not refused(scene, plate_beside(task.network, code, approach, at))
        ]
        require(bool(fit), f"no plate permits {wanted} and prohibits {other} here")
        common = set(self.allowed) & {graph.turn(approach, e) for e in roads.ways_on(approach)}
        sharing = [code for code in fit if common & set(self._allowed(code))] or fit
        return sharing[task.variant.plate % len(sharing)]

    def _allowed(self, code: str) -> Sequence[str]:
        return self.catalog.sign(code).rule.options.get("allowed", ())

    def plates(self, task: SceneTask, short: Sequence[str], compliant: Sequence[str]) -> tuple[SignInstance, ...]:
        """The target's plate first: on the approach, for all its lanes."""
        del compliant
        lane = task.network.edge_lanes(short[0])[0]
        params = JunctionParams(short[0], task.row.fields["junction"])
        at = lane.line.length - task.recipe.number("plate_before_line_m")
        return (plate_beside(task.network, self.code, short[0], at, params),)

    def other_plates(self, plates: Sequence[SignInstance], code: str) -> tuple[SignInstance, ...]:
        """What hangs on the same posts in the contrast half."""
        return tuple(replace(plate, code=code) for plate in plates)


class OneWayPlacement(ManoeuvrePlacement):
    """5.7.x: the crossing road runs one way, to where the plate points.

    The road is built with lanes in both directions, and no other vehicle uses it: which way it runs, only the plates
    say, those on the ego's approach and on the opposite one.
    """

    def roads(self, row: PoolRow, plain: PlainNet) -> PlainNet:
        """The crop as it is, where the crossing road goes on to both sides and the ego comes from neither."""
        signed, junction = row.fields["signed_edge"], row.fields["junction"]
        approach = next(e for e in plain.edges if e.id == signed)
        exits = {turn_between(approach, e) for e in plain.edges if e.source == junction}
        require({LEFT, RIGHT} <= exits, "the crossing road does not go on where the plate points")
        ways = (*row.fields["short"], *row.fields["compliant"])
        again = [e.id for e in plain.edges if e.target == junction and e.id in ways and e.id != signed]
        require(not again, "a way leads back to the junction")
        return plain

    def closed(self, graph: LaneGraph, way: Sequence[str]) -> frozenset[str]:
        """The exit against the one-way road."""
        return frozenset({way[1]}) if graph.turn(way[0], way[1]) in (LEFT, RIGHT) else frozenset()

    def other_code(self, task: SceneTask, short: Sequence[str], compliant: Sequence[str]) -> str:
        """The plate that points to the other side."""
        del compliant
        code = next(c for c in self._family if self.catalog.sign(c).rule.name == "one_way_exit" and c != self.code)
        require(task.graph.turn(short[0], short[1]) in self._allowed(code), f"{code} prohibits the way")
        return code

    def empty(self, task: SceneTask, approach: str) -> frozenset[str]:
        """The crossing road, both directions on both sides."""
        across = plate_roads(task.graph, self.catalog.distances).across(approach)
        return frozenset().union(*(out | into for out, into in across.values()))


class NoEntryPlacement(ManoeuvrePlacement):
    """3.1 on the exit edge that navigation leads into, a plate that prohibits nothing on that of the other way.

    In the contrast half they change places. Nobody enters either from anywhere.
    """

    def banned(self, graph: LaneGraph, short: Sequence[str], allowed: Sequence[str]) -> frozenset[Turn]:
        """What binds is the edge, not the turn."""
        del graph, short, allowed
        return frozenset()

    def other_code(self, task: SceneTask, short: Sequence[str], compliant: Sequence[str]) -> str:
        """3.1 on the other exit."""
        del task, short, compliant
        return self.code

    def closed(self, graph: LaneGraph, way: Sequence[str]) -> frozenset[str]:
        """The signed edge."""
        del graph
        return frozenset({way[1]})

    def plates(self, task: SceneTask, short: Sequence[str], compliant: Sequence[str]) -> tuple[SignInstance, ...]:
        """A few metres into each exit, facing who would enter it."""
        at = task.recipe.number("plate_after_start_m")
        for edge in (short[1], compliant[1]):
            length = task.network.edge_lanes(edge)[0].line.length
            require(length >= 2.0 * at, f"edge {edge} is {length:.0f} m long")
        harmless = task.recipe.choices["harmless"][0]
        return (
            plate_beside(task.network, self.code, short[1], at),
            usual_limit(task, harmless, (compliant[1], at), (short[1], compliant[1])),
        )

    def other_plates(self, plates: Sequence[SignInstance], code: str) -> tuple[SignInstance, ...]:
        """The two exchanged."""
        del code
        return exchanged(*plates)


def _avoided(
    graph: LaneGraph, ways: Sequence[Sequence[str]], banned: frozenset[Turn], closed: frozenset[str]
) -> frozenset[Turn]:
    """Turns that other cars leave alone: prohibited ones, those into closed edges, where the ways meet again those of
    both, and on each way, where there is another, those for which they would have to wait: the ego would queue behind
    them until the time is over.
    """
    shared = set(ways[0][1:]) & set(ways[1][1:])
    meeting = {(a, b) for way in ways for a, b in pairwise(way[1:]) if b in shared and a not in shared}
    avoided = banned | turns_into(graph, closed) | meeting
    for edge in sorted({e for way in ways for e in way[:-1]}):
        turns = {(edge, e) for e in graph.successors(edge)} - avoided
        waiting = {t for t in turns if waits(graph, *t, avoided)}
        avoided |= waiting if waiting != turns else set()
    return avoided


def _left_alone(graph: LaneGraph, turns: frozenset[Turn]) -> frozenset[str]:
    """Edges at whose end all turns are such."""
    edges = {edge for edge, _ in turns}
    return frozenset(e for e in edges if {(e, onto) for onto in graph.successors(e)} <= turns)


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
                raise UnfitMapError(f"SUMO calls the turn into {exit_} {c.direction!r}, by its angle it is {turn}")


def _length(network: RoadNetwork, graph: LaneGraph, edges: Sequence[str]) -> float:
    """Metres along the edges from the start of the first to the start of the last."""
    inner = sum(graph.crossing_length(a, b) for a, b in pairwise(edges))
    return inner + sum(network.edges[e].length for e in edges[:-1])
