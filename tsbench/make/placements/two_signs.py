"""Two signs that bind the ego at once: the scene of the last one, with the first one's plate on its approach."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tsbench.geometry.elementary import LEFT, RIGHT, turn_class
from tsbench.make.maps.pieces import heading_towards
from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.dual_path import ManoeuvrePlacement
from tsbench.make.placements.junction_priority import AFTER_S, Arms, conflicts, convoy, gives_way, how_late, link
from tsbench.make.placements.placement import Arrangement, ConvoySetup, ScenePlacement, SceneTask, plate_beside, require
from tsbench.make.placements.speed_zone import KMH, SpeedZonePlacement, ZonePlacement, fastest_before
from tsbench.make.scenes.plate_roads import plate_roads
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.annotations import DISTRACTOR, TARGET, SignInstance, overruled
from tsbench.signs.contrast import ContrastClause, PassageParams, SlowZoneParams
from tsbench.signs.rule_kinds import GiveWayParams, ZoneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M

# SUMO's priority of the road that gives way.
_SECOND = 1


class TwoSignsPlacement(ScenePlacement):
    """A plate before the last sign, which stays in the last sign's contrast half and changes in its own.

    recipe: of the type. last: the placement of its last part. decides: the part (0, 1) whose plates other traffic goes
    by, and for whose contrast half there is a network of its own.
    """

    decides = 1

    def __init__(self, recipe: Recipe, last: ScenePlacement) -> None:
        super().__init__(recipe)
        assert recipe.first is not None
        assert recipe.last is not None
        self._first = replace(recipe.first, numbers=recipe.first.numbers | recipe.numbers)
        self._recipe_of_last = recipe.last
        self._last = last

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:  # noqa: ARG002
        """As the last sign needs it."""
        return self._last.prepare(row, plain, self._recipe_of_last)

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:  # noqa: ARG002
        """As the last sign's contrast plates need it."""
        return self._last.prepare_contrast(row, plain, self._recipe_of_last)

    def place(self, task: SceneTask) -> Arrangement:
        """Both plates bind."""
        return self._with_first(task, self._last.place(replace(task, recipe=self._recipe_of_last)))

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The last sign's contrast plates; the first one's stay."""
        last = signed.targets[1:]
        bare = replace(signed, signs=signed.signs[: _count_of_last(signed)], targets=last)
        found = self._last.contrast(replace(task, recipe=self._recipe_of_last), bare)
        if found is None:
            return None
        of_last = tuple(replace(clause, sign=last[0]) for clause in found.contrast)
        return self._with_first(task, replace(found, contrast=of_last))

    @abstractmethod
    def _with_first(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """The last sign's scene with the first one's plates behind its own. Raises UnfitMapError."""

    @abstractmethod
    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The first sign's contrast plates; the last one's stay."""


class LimitAheadPlacement(TwoSignsPlacement):
    """A limit on the approach to what the last sign is about; it holds until the junction there, or until the last
    sign, if that is a limit too.
    """

    def __init__(self, recipe: Recipe, last: ScenePlacement) -> None:
        super().__init__(recipe, last)
        assert recipe.first is not None
        kind = ZonePlacement if recipe.first.placement == "zone" else SpeedZonePlacement
        self._limit = kind(recipe.first)

    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The limit's contrast plate."""
        count = _count_of_last(signed)
        plate, road = signed.signs[count], self._on_approach(task, signed.start)
        value = self._limit.other(road, plate.posted, self._posted(signed.signs[:count]))
        until = _place_of_last(task, signed) - self._first.number("slow_until_last_m")
        slow = SlowZoneParams((plate.edge,), plate.position_m, until, min(value, road.row.speed_mps / KMH))
        clause = ContrastClause("needless_slow", slow, plate.id)
        signs = (*signed.signs[:count], *(replace(sign, value=value) for sign in signed.signs[count:]))
        return replace(signed, signs=signs, contrast=(clause, *signed.contrast))

    def _posted(self, of_last: Sequence[SignInstance]) -> list[float]:
        return [sign.posted for sign in of_last if sign.code == self._limit.code]

    def _on_approach(self, task: SceneTask, start: EgoStart) -> SceneTask:
        """The task of the limit, whose road is the ego's approach."""
        lane = task.network.lane(start.lane)
        road = task.network.edges[lane.edge].road_class.removeprefix("highway.")
        row = replace(task.row, road_class=road, speed_mps=lane.speed)
        return replace(task, row=row, recipe=self._first)

    def _with_first(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """The ego comes too fast for the limit, so far before its plate that it can slow down."""
        road, first = self._on_approach(task, a.start), self._first
        lane = task.network.lane(a.start.lane)
        limits = self._limit.limits(road.row, first, self._posted(a.signs))
        limit = float(limits[task.variant.value % len(limits)])
        at, v = _place_of_last(task, a) - first.number("limit_before_last_m"), limit * KMH
        least = first.number("least_excess_mps")
        fastest = fastest_before(first, at - a.start.s - EGO_LENGTH_M / 2, v)
        require(fastest >= v + least, f"no room to brake from {v + least:.1f} m/s before the limit")
        asked = v + min(max(least, task.variant.initial_speed), first.number("most_excess_kmh") * KMH)
        v0 = min(asked, fastest, lane.speed)
        network, number, drivers = task.network, len(a.signs), a.drivers
        plate = plate_beside(
            network, self._limit.code, lane.edge, at, ZoneParams((lane.edge,)), number=number, value=limit
        )
        end: tuple[SignInstance, ...] = ()
        if isinstance(self._limit, ZonePlacement):
            back = self._limit.across(task, lane.edge, at)
            code = self._limit.end_code
            end = (plate_beside(network, code, *back, number=number + 1, role=DISTRACTOR, value=limit),)
            drivers = tuple(replace(d, speed=min(d.speed, v)) for d in drivers)
        return replace(
            a,
            signs=(*a.signs, plate, *end),
            drivers=drivers,
            targets=(plate.id, *a.targets),
            start=replace(a.start, speed=v0),
            closed_edges=frozenset({*a.closed_edges, lane.edge}),
        )


class TemporaryLimitPlacement(LimitAheadPlacement):
    """Two limits on one road: where they differ, the temporary one rules, until the next junction.

    It stands first, in the last sign's contrast half second: the grounds change places. In the first sign's contrast
    half the values do; otherwise the first one is the lower. The ego's way ends before the junction.
    Source: docs/contrast.md, "Two signs at once".
    """

    def __init__(self, recipe: Recipe) -> None:
        assert recipe.last is not None
        super().__init__(recipe, _LimitUntilJunction(recipe.last))

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The grounds exchanged."""
        last, first = signed.signs
        until_last = replace(first, params=ZoneParams((first.edge,)), temporary=False)
        return self._with_clauses(task, replace(signed, signs=(replace(last, temporary=True), until_last)))

    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The values exchanged."""
        last, first = signed.signs
        signs = (replace(last, value=first.value), replace(first, value=last.value))
        return self._with_clauses(task, replace(signed, signs=signs))

    def _with_clauses(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """No stretch where the higher value rules is driven needlessly slowly."""
        last, first = a.signs
        zone = last.params_as(ZoneParams).zone_edges[:-1]
        lower, road = min(last.posted, first.posted), task.network.lane(a.start.lane).speed / KMH
        length = sum(task.network.edge_lanes(edge)[0].line.length for edge in zone)
        until = _place_of_last(task, a) - self._first.number("slow_until_last_m")
        from_last = self._first.number("slow_from_last_m")
        stretches = (
            (first.id, first.posted, (first.edge,), first.position_m, until),
            (last.id, (first if overruled(last, [first]) else last).posted, zone, from_last, length),
        )
        clauses = tuple(
            ContrastClause("needless_slow", SlowZoneParams(edges, start, end, min(value, road)), sign)
            for sign, value, edges, start, end in stretches
            if value > lower
        )
        return replace(a, contrast=clauses)

    def _posted(self, of_last: Sequence[SignInstance]) -> list[float]:  # noqa: ARG002
        """The last sign's value is chosen behind the first one's."""
        return []

    def _with_first(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """The first plate is the temporary one, and posts the lower value."""
        found = super()._with_first(task, a)
        last, first = found.signs
        value = self._limit.other(self._on_approach(task, a.start), first.posted)
        zone = ZoneParams((first.edge, *last.params_as(ZoneParams).zone_edges))
        return replace(found, signs=(replace(last, value=value), replace(first, params=zone, temporary=True)))


class _LimitUntilJunction(SpeedZonePlacement):
    """A limit without an end plate, which would tell from afar what rules."""

    behind_zone = ("end_before_edge_m",)
    ends_in_zone = True

    def _signs(self, task: SceneTask, zone: Sequence[str], last: str, limit: float) -> tuple[SignInstance, ...]:
        return super()._signs(task, zone, last, limit)[:1]


class StopAheadPlacement(TwoSignsPlacement):
    """A stop plate at the junction where the last sign says which way is open. No other vehicle comes to it.

    In the contrast half the ego's and the opposite approach exchange it for a plate that asks to give way, as on the
    maps of `stop` where nobody comes.
    """

    # Of the recipe's choices: plates of the crossing road and of the opposite approach, and the ego's contrast plate.
    plates = ("main_plates", "empty_plates", "empty_plates")
    # So many approaches come from straight ahead, at least.
    opposite = 1

    def __init__(self, recipe: Recipe) -> None:
        assert recipe.last is not None
        assert recipe.first is not None
        super().__init__(recipe, _NobodyComes(recipe.last))
        self.code, choices = recipe.first.type.codes[0], recipe.first.choices
        self._main, self._other, self._instead = (str(choices[key][0]) for key in self.plates)

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The crossing road goes first."""
        return _with_first_road(super().prepare(row, plain, recipe), row, recipe, crossing=True)

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The same: the plates of the other way mean nothing else to other traffic."""
        return self.prepare(row, plain, recipe)

    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The ego's and the opposite plate exchanged."""
        plate = signed.signs[_count_of_last(signed)]
        swapped = {plate.code: self._instead, self._instead: plate.code}
        params = replace(plate.params_as(GiveWayParams), main_in=self._first_in_contrast(task, plate))
        way = signed.compliant_hint or signed.route_hint
        passage = PassageParams(plate.edge, way[1], params.main_in)
        clauses = (ContrastClause(name, passage, plate.id) for name in ("needless_stop", "needless_yield"))
        exchanged = (replace(sign, code=swapped.get(sign.code, sign.code)) for sign in signed.signs)
        signs = tuple(replace(sign, params=params) if sign.id == plate.id else sign for sign in exchanged)
        return replace(signed, signs=signs, contrast=(*clauses, *signed.contrast))

    def _first_in_contrast(self, task: SceneTask, plate: SignInstance) -> tuple[str, ...]:  # noqa: ARG002
        """Edges whose vehicles go before the ego's in the contrast half: the same."""
        return plate.params_as(GiveWayParams).main_in

    def _with_first(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """The stop plate on the ego's approach, before the last sign's, and those of the other approaches."""
        approach, junction = task.row.fields["signed_edge"], task.row.fields["junction"]
        across, opposite = _other_approaches(task, approach)
        require(len(opposite) >= self.opposite, "no approach comes from straight ahead")
        hung = [(approach, self.code, self._first.number("first_before_line_m"))]
        before = self._first.number("plate_before_line_m")
        hung += [(edge, self._other, before) for edge in opposite] + [(edge, self._main, before) for edge in across]
        plates = []
        for number, (edge, code, to_line) in enumerate(hung, len(a.signs)):
            s = task.network.edge_lanes(edge)[0].line.length - to_line
            require(s >= 0.0, f"edge {edge} has no room for a plate")
            plates.append(plate_beside(task.network, code, edge, s, number=number, role=DISTRACTOR))
        params = GiveWayParams(approach, junction, tuple(sorted(across)))
        stop = replace(plates[0], params=params, role=TARGET)
        return replace(a, signs=(*a.signs, stop, *plates[1:]), targets=(stop.id, *a.targets))


class YieldAheadPlacement(StopAheadPlacement):
    """A plate that asks to give way there, and a convoy on the crossing road that meets the ego on either way.

    In the contrast half all approaches exchange their plates, and the convoy gives way. No other vehicle comes.
    """

    decides = 0
    plates = ("main_plates", "minor_plates", "main_plates")
    opposite = 0

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The crossing road goes first."""
        return _by_priority(super().prepare(row, plain, recipe), row)

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The ego's road goes first."""
        found = self._last.prepare(row, plain, self._recipe_of_last)
        return _by_priority(_with_first_road(found, row, recipe, crossing=False), row)

    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The convoy gives way to an ego that goes as the last sign says."""
        cars, way = signed.convoy, signed.compliant_hint or signed.route_hint
        assert cars is not None
        theirs, own = link(task.network, cars.lane, cars.edges[1]), link(task.network, signed.start.lane, way[1])
        require(gives_way(theirs, own), "with other plates the convoy does not give way to the ego")
        return super().first_contrast(task, signed)

    def _first_in_contrast(self, task: SceneTask, plate: SignInstance) -> tuple[str, ...]:
        """The opposite approach: it is on the ego's road."""
        return tuple(_other_approaches(task, plate.edge)[1])

    def _with_first(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """With the convoy, which the last sign's halves share."""
        found = super()._with_first(task, a)
        return found if found.convoy else replace(found, convoy=self._convoy(replace(task, recipe=self._first), a))

    def _convoy(self, task: SceneTask, a: Arrangement) -> ConvoySetup:
        """Timed for the navigation's way, where it meets the ego about as late on the other one."""
        network, recipe = task.network, self._first
        across, _ = _other_approaches(task, a.route_hint[0])
        arms = Arms(a.route_hint[0], tuple(across), (), frozenset(), bends=False)
        slowest, farthest = recipe.number("slowest_turn_mps"), recipe.number("convoy_most_to_zone_m")
        found = conflicts(network, task.graph, arms, slowest_turn=slowest, most_to_zone=farthest)
        there = {(network.lanes[c.ego.to_lane].edge, c.priority): c for c in found}
        exits = [way[1] for way in (a.route_hint, a.compliant_hint)]
        pairs = [(c, there.get((exits[1], c.priority))) for (exit_, _), c in there.items() if exit_ == exits[0]]
        known = [(c, late) for c, other in pairs if other is not None and (late := how_late(task, c, other))]
        require(bool(known), "no path that has priority meets the ego's late enough, and soon enough, on either way")
        chosen, late = known[task.variant.layout % len(known)]
        numbers = recipe.numbers | dict(zip(AFTER_S, late, strict=True))
        return convoy(replace(task, recipe=replace(recipe, numbers=numbers)), chosen)


def _with_first_road(plain: PlainNet, row: PoolRow, recipe: Recipe, *, crossing: bool) -> PlainNet:
    """The net where of the signed junction's roads the crossing one goes first, or the ego's."""
    ego = next(e for e in plain.edges if e.id == row.fields["signed_edge"])
    heading = heading_towards(np.array(ego.shape))
    into = [e for e in plain.edges if e.target == ego.target]
    turned = {e.id: turn_class(heading_towards(np.array(e.shape)) - heading + 180.0) for e in into}
    first = int(recipe.number("main_priority"))
    crosses = {e: turned[e] in (LEFT, RIGHT) and e != ego.id for e in turned}
    priority = {e: first if crosses[e] == crossing else _SECOND for e in turned}
    return replace(plain, edges=tuple(replace(e, priority=priority.get(e.id, e.priority)) for e in plain.edges))


def _by_priority(plain: PlainNet, row: PoolRow) -> PlainNet:
    """The net where at the signed junction only the priorities of the edges into it count."""
    node = row.fields["junction"]
    nodes = (replace(n, type="priority", right_of_way="edgePriority") if n.id == node else n for n in plain.nodes)
    return replace(plain, nodes=tuple(nodes))


class _NobodyComes(ManoeuvrePlacement):
    """A manoeuvre at a junction that no other vehicle comes to."""

    def banned(self, graph: LaneGraph, short: Sequence[str], allowed: Sequence[str]) -> frozenset[Turn]:
        """Besides, all turns from other approaches."""
        edges, here = graph.network.edges, graph.network.edges[short[0]].target
        others = (e for e in edges if edges[e].target == here and e != short[0])
        return super().banned(graph, short, allowed) | {(e, onto) for e in others for onto in graph.successors(e)}

    def empty(self, task: SceneTask, approach: str) -> frozenset[str]:
        """All approaches of the junction."""
        edges = task.network.edges
        return frozenset(e for e in edges if edges[e].target == edges[approach].target)


def _other_approaches(task: SceneTask, approach: str) -> tuple[list[str], list[str]]:
    """Of a junction: the approaches on the crossing road, and the opposite one. Raises UnfitMapError."""
    roads = plate_roads(task.graph, task.recipe.catalog.distances)
    across = sorted(e for _, into in roads.across(approach).values() for e in into)
    node = task.network.edges[approach].target
    opposite = [e for e in task.network.edges if task.network.edges[e].target == node and e not in (approach, *across)]
    require(len(opposite) <= 1 and bool(across), "no road crosses, or no single approach comes from straight ahead")
    return across, opposite


def _count_of_last(a: Arrangement) -> int:
    """How many plates are the last sign's; the first sign's follow."""
    return next(k for k, sign in enumerate(a.signs) if sign.id == a.targets[0])


def _place_of_last(task: SceneTask, a: Arrangement) -> float:
    """Where the last sign is along the ego's approach, or where that ends before it; m."""
    edge = task.network.lane(a.start.lane).edge
    plate = next(sign for sign in a.signs if sign.id == a.targets[-1])
    return plate.position_m if plate.edge == edge else task.network.edge_lanes(edge)[0].line.length
