"""Junction scenes where the ego gives way: its arm, the arms with priority, a convoy on one of these.

Source: docs/scenes.md, "Priority at junctions".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import replace
from types import MappingProxyType

from lxml import etree

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.distractors import in_sight
from tsbench.make.placements.junction_priority import (
    SHARES,
    Arms,
    Conflict,
    bending_arms,
    conflicts,
    convoy,
    convoy_speed,
    ego_speeds,
    exchanged_arms,
    gives_way,
    line_lead,
    link,
    through_arms,
    with_priorities,
)
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    before_line,
    keep_clear,
    passenger_lanes,
    plate_beside,
    require,
    start_speed,
)
from tsbench.make.scenes.recipe import Recipe
from tsbench.make.scenes.traffic import waiting_elements
from tsbench.make.seeds import rng_of
from tsbench.roads.lane_graph import Destination, Turn
from tsbench.roads.network import RoadNetwork
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, TARGET, SignInstance
from tsbench.signs.contrast import ContrastClause, PassageParams
from tsbench.signs.rule_kinds import GiveWayParams
from tsbench.sim.convoy import predicted_arrival
from tsbench.sim.scene import EgoStart

# By the catalogue's word for the arms with priority.
_ROLES: Mapping[str, Callable[[PoolRow, float], Arms]] = MappingProxyType(
    {"main_arms": through_arms, "main_arm_on_right": bending_arms}
)
_FIRST_PLATE_M = 2.0
_ROOM_M = 14.0


class GiveWayPlacement(ScenePlacement):
    """`yield`, `stop`, `secondary_road`, `main_road`: what they differ in stands in the catalogue and the recipe.

    In the contrast half the plates on the same posts are others: the ego comes on the main road, and the convoy gives
    way to it. On some maps of `stop` nobody comes, and the ego and the opposite approach exchange a stop and a yield
    plate. `secondary_road` has no plate on the ego's approach: the convoy's and the opposite one exchange theirs, and
    from the fourth arm, which has none, no vehicle comes.
    """

    def __init__(self, recipe: Recipe) -> None:
        sign = recipe.catalog.sign(recipe.type.codes[0])
        self._code, self._faces = sign.code, sign.placement.faces
        self._stops = sign.rule.name == "stop"
        self._roles = _ROLES[sign.rule.option("priority_to")]

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """Priorities as the plates state them."""
        arms = self._roles(row, recipe.number("ego_before_line_m"))
        return with_priorities(row, plain, arms, recipe, self._stops)

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """Priorities as the other plates state them."""
        stops = self._stops and not _nobody_comes(row, recipe)
        return with_priorities(row, plain, self._contrast_arms(row, recipe), recipe, stops)

    def _contrast_arms(self, row: PoolRow, recipe: Recipe) -> Arms:
        arms = self._roles(row, recipe.number("ego_before_line_m"))
        return arms if _nobody_comes(row, recipe) else exchanged_arms(row, arms)

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 m before the line, a convoy timed to meet it."""
        row, network, graph, recipe, variant = task.row, task.network, task.graph, task.recipe, task.variant
        before = recipe.number("ego_before_line_m")
        arms = self._roles(row, before)
        into = (arms.ego_in, *arms.prior_in, *arms.minor_in)
        lanes = [len(passenger_lanes(network, edge)) for edge in into if edge in network.edges]
        # In one half each road has priority over the other.
        require(max(lanes) == min(lanes), f"roads of {min(lanes)} and {max(lanes)} lanes each way cross")
        slowest, farthest = recipe.number("slowest_turn_mps"), recipe.number("convoy_most_to_zone_m")
        options = conflicts(network, graph, arms, slowest_turn=slowest, most_to_zone=farthest)
        require(bool(options), "no path of the ego meets, near its line, one that has priority")
        slow, latest = recipe.number(SHARES[0]), recipe.number("convoy_most_after_s")
        options = [c for c in options if line_lead(task, c, convoy_speed(task, c, slow)) <= latest]
        require(bool(options), "who has priority shows what it does before the ego is at its line")
        chosen = options[variant.layout % len(options)]
        lane, exit_lane = network.lanes[chosen.ego.from_lane], network.lanes[chosen.ego.to_lane]
        start = EgoStart(lane.id, before_line(lane, before), start_speed(task, lane))
        room, least = (exit_lane.line.length - recipe.number("end_before_edge_m"), recipe.number("least_exit_m"))
        require(room >= least, f"the exit arm is {exit_lane.line.length:.0f} m long")
        end_s = variant.route_end(least, room)
        route = (lane.edge, exit_lane.edge)
        require(graph.route(lane.edge, exit_lane.edge) == route, "the exit is not the next edge of the route")
        signs = self._plates(task, arms, chosen, start)
        bare = frozenset(arms.prior_in) - {s.edge for s in signs}
        cars = None if _nobody_comes(row, recipe) else convoy(task, chosen)
        # Nobody else is at the junction before the ego: the order in which others go would tell what the plates say.
        turn, cruise = ego_speeds(task, chosen.ego)
        quiet_s = predicted_arrival(before, before, start.speed, cruise, turn)
        avoid = _others(network, arms, chosen)
        waiting, taken = _waiting(task, arms, avoid)
        return Arrangement(
            signs=signs, targets=(signs[0].id,), start=start, destination=Destination(exit_lane.edge, end_s),
            closed_edges=bare, route_hint=route, route_length=end_s, convoy=cars, extra=waiting,
            avoid_turns=avoid, quiet_edges=frozenset({arms.ego_in, *arms.prior_in, *arms.minor_in}),
            platoons=frozenset(arms.prior_in), quiet_s=quiet_s,
            blocked=(*keep_clear(passenger_lanes(network, lane.edge), start), *taken),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The other plates on the same posts; no vehicle goes before the ego."""
        arms, recipe = self._contrast_arms(task.row, task.recipe), task.recipe
        exit_edge, cars = signed.destination.edge, signed.convoy
        if cars is not None:
            own = link(task.network, signed.start.lane, exit_edge)
            other = link(task.network, cars.lane, cars.edges[1])
            require(gives_way(other, own), "with other plates the convoy does not give way to the ego")
        main, minor = (str(recipe.choices[key][0]) for key in ("main_plates", "minor_plates"))
        if cars is None:
            swapped = {self._code: _empty_plate(recipe), _empty_plate(recipe): self._code}
            codes = {s.id: swapped.get(s.code, s.code) for s in signed.signs}
        else:
            codes = {s.id: main if s.edge in arms.main else minor for s in signed.signs}
        binding = GiveWayParams(arms.ego_in, task.row.fields["node"], arms.prior_in)
        passage = PassageParams(arms.ego_in, exit_edge, arms.prior_in)
        return replace(
            signed,
            signs=tuple(replace(s, code=codes[s.id], params=binding if s.params else None) for s in signed.signs),
            contrast=(ContrastClause("needless_stop", passage), ContrastClause("needless_yield", passage)),
        )

    def _plates(self, task: SceneTask, arms: Arms, chosen: Conflict, start: EgoStart) -> tuple[SignInstance, ...]:
        """The target first, on the convoy's arm where it faces the main road; the others speak to other traffic."""
        network, recipe = task.network, task.recipe
        minor = _empty_plate(recipe) if _nobody_comes(task.row, recipe) else recipe.choices["minor_plates"][0]
        if self._faces == "main_arms":
            wanted = [(network.lanes[chosen.priority.from_lane].edge, self._code)]
        else:
            wanted = [(arms.ego_in, self._code)]
            wanted += [(e, str(recipe.choices["main_plates"][0])) for e in arms.prior_in]
        wanted += [(e, str(minor)) for e in arms.minor_in]
        binding = GiveWayParams(arms.ego_in, task.row.fields["node"], arms.prior_in)
        before, plates = recipe.number("plate_before_line_m"), []
        for k, (edge, code) in enumerate(wanted):
            s = max(network.edge_lanes(edge)[0].line.length - before, _FIRST_PLATE_M)
            # Without params a plate binds no watched vehicle.
            params, role = (None, DISTRACTOR) if k else (binding, TARGET)
            plates.append(plate_beside(network, code, edge, s, params, number=k, role=role))
        if self._faces == "main_arms":
            for post in plates:
                require(in_sight(task, start, post), "a plate is out of the ego's sight")
        return tuple(plates)


def _nobody_comes(row: PoolRow, recipe: Recipe) -> bool:
    """Is this one of the maps without a convoy?"""
    share = recipe.numbers.get("empty_share", 0.0)
    return bool(rng_of("empty", recipe.type.id, row.map_id).uniform() < share)


def _empty_plate(recipe: Recipe) -> str:
    """The plate that the ego's and the opposite approach exchange without other traffic."""
    return str(recipe.choices["empty_plates"][0])


def _others(network: RoadNetwork, arms: Arms, chosen: Conflict) -> frozenset[Turn]:
    """Turns that other traffic does not take.

    Nobody turns off the main road where it waits for its other direction: who stands there blocks the junction for a
    minute. Where the ego is on the main road, no vehicle from a secondary arm goes before it, though SUMO would let it.
    """
    held = set[Turn]()
    for edge in arms.prior_in:
        states = _states(network, edge)
        if any("M" in s for s in states.values()):
            held |= {turn for turn, s in states.items() if "M" not in s}
    for edge in arms.minor_in if arms.bends else ():
        for lane in passenger_lanes(network, edge):
            for c in network.outgoing[lane.index]:
                if not chosen.ego.yields_to.isdisjoint(c.via):
                    held.add((edge, network.lanes[c.to_lane].edge))
    return frozenset(held)


def _states(network: RoadNetwork, edge: str) -> dict[Turn, set[str]]:
    """SUMO's states of the connections by which an edge is left."""
    states: dict[Turn, set[str]] = {}
    for lane in passenger_lanes(network, edge):
        for c in network.outgoing[lane.index]:
            states.setdefault((edge, network.lanes[c.to_lane].edge), set()).add(c.state)
    return states


def _waiting(
    task: SceneTask, arms: Arms, avoid: AbstractSet[Turn]
) -> tuple[tuple[etree._Element, ...], tuple[tuple[str, float, float], ...]]:
    """Now and then a car that waits on a secondary arm and has no priority; and the room that it takes."""
    network, rng = task.network, task.rng
    share = task.recipe.numbers.get("waiting_share", 0.0)
    if not arms.minor_in or rng.uniform() >= share:
        return (), ()
    edge = arms.minor_in[int(rng.integers(len(arms.minor_in)))]
    lane = passenger_lanes(network, edge)[0]
    ways = [network.lanes[c.to_lane].edge for c in network.outgoing[lane.index]]
    ways = [e for e in ways if (edge, e) not in avoid]
    if not ways or lane.line.length < _ROOM_M:
        return (), ()
    route = (edge, ways[int(rng.integers(len(ways)))])
    elements = waiting_elements(task.drivers[0], lane, route, task.recipe.number("waiting_s"))
    return tuple(elements), ((lane.id, lane.line.length - _ROOM_M, lane.line.length),)
