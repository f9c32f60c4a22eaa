"""Two signs that bind the ego at once: the scene of the last one, with the first one's plate on its approach."""

from __future__ import annotations

from dataclasses import replace

from tsbench.make.maps.plain import PlainNet
from tsbench.make.placements.placement import Arrangement, ScenePlacement, SceneTask, plate_beside, require
from tsbench.make.placements.speed_zone import KMH, SpeedZonePlacement, fastest_before
from tsbench.make.scenes.recipe import Recipe
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.contrast import ContrastClause, SlowZoneParams
from tsbench.signs.plate_params import ZoneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


class LimitAheadPlacement(ScenePlacement):
    """A limit on the approach to what the last sign is about; it holds until the junction there.

    recipe: of the type. last: the placement of its last part.
    """

    def __init__(self, recipe: Recipe, last: ScenePlacement) -> None:
        super().__init__(recipe)
        assert recipe.first is not None
        assert recipe.last is not None
        self._first = replace(recipe.first, numbers=recipe.first.numbers | recipe.numbers)
        self._recipe_of_last = recipe.last
        self._limit, self._last = SpeedZonePlacement(recipe.first), last

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:  # noqa: ARG002
        """As the last sign needs it."""
        return self._last.prepare(row, plain, self._recipe_of_last)

    def prepare_contrast(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:  # noqa: ARG002
        """As the last sign's contrast plates need it."""
        return self._last.prepare_contrast(row, plain, self._recipe_of_last)

    def place(self, task: SceneTask) -> Arrangement:
        """Both plates bind."""
        return self._with_limit(task, self._last.place(replace(task, recipe=self._recipe_of_last)))

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement | None:
        """The last sign's contrast plates; the limit stays."""
        bare = replace(signed, signs=signed.signs[:-1], targets=signed.targets[1:])
        found = self._last.contrast(replace(task, recipe=self._recipe_of_last), bare)
        return None if found is None else self._with_limit(task, found)

    def first_contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The limit's contrast plate; the others stay."""
        plate, road = signed.signs[-1], self._on_approach(task, signed.start)
        value = self._limit.other(road, plate.posted)
        until = _place_of_last(task, signed) - self._first.number("slow_until_last_m")
        slow = SlowZoneParams((plate.edge,), plate.position_m, until, min(value, road.row.speed_mps / KMH))
        clause = ContrastClause("needless_slow", slow, plate.id)
        signs = (*signed.signs[:-1], replace(plate, value=value))
        return replace(signed, signs=signs, contrast=(clause, *signed.contrast))

    def _on_approach(self, task: SceneTask, start: EgoStart) -> SceneTask:
        """The task of the limit, whose road is the ego's approach."""
        lane = task.network.lane(start.lane)
        road = task.network.edges[lane.edge].road_class.removeprefix("highway.")
        row = replace(task.row, road_class=road, speed_mps=lane.speed)
        return replace(task, row=row, recipe=self._first)

    def _with_limit(self, task: SceneTask, a: Arrangement) -> Arrangement:
        """The ego comes too fast for the limit, so far before its plate that it can slow down."""
        road, first = self._on_approach(task, a.start), self._first
        lane = task.network.lane(a.start.lane)
        limits = self._limit.limits(road.row, first)
        limit = float(limits[task.variant.value % len(limits)])
        at, v = _place_of_last(task, a) - first.number("limit_before_last_m"), limit * KMH
        least = first.number("least_excess_mps")
        fastest = fastest_before(first, at - a.start.s - EGO_LENGTH_M / 2, v)
        require(fastest >= v + least, f"no room to brake from {v + least:.1f} m/s before the limit")
        asked = v + min(max(least, task.variant.initial_speed), first.number("most_excess_kmh") * KMH)
        v0 = min(asked, fastest, lane.speed)
        plate = plate_beside(
            task.network, self._limit.code, lane.edge, at, ZoneParams((lane.edge,)), number=len(a.signs), value=limit
        )
        return replace(
            a,
            signs=(*a.signs, plate),
            targets=(plate.id, *a.targets),
            start=replace(a.start, speed=v0),
            contrast=tuple(replace(clause, sign=a.targets[0]) for clause in a.contrast),
            closed_edges=frozenset({*a.closed_edges, lane.edge}),
        )


def _place_of_last(task: SceneTask, a: Arrangement) -> float:
    """Where the last sign is along the ego's approach, or where that ends before it; m."""
    edge = task.network.lane(a.start.lane).edge
    plate = next(sign for sign in a.signs if sign.id == a.targets[-1])
    return plate.position_m if plate.edge == edge else task.network.edge_lanes(edge)[0].line.length
