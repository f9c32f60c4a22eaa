"""A lane for buses or cyclists in the ego's own direction, where the ego drives.

Source: docs/scenes.md, "Reserved lanes". Units: m.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.dataset.maps.plain import PlainLane, PlainNet
from tsbench.dataset.placements.corridor import split_edge
from tsbench.dataset.placements.lane_users import lane_users
from tsbench.dataset.placements.placement import (
    Arrangement,
    ConvoySetup,
    ScenePlacement,
    SceneTask,
    plate_beside,
    require,
    start_speed,
)
from tsbench.dataset.scenes.recipe import Recipe
from tsbench.roads.destination import Destination
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import ContrastClause, WayParams
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


class ReservedLanePlacement(ScenePlacement):
    """`bus_lane`, `bike_lane`: from the plate on the rightmost lane is for others, to the end of the marked zone.

    In the contrast half it is the lane beside it. In both its users are on both lanes, and other traffic is on neither:
    which one is theirs, only the plate says.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]
        self.users = load_catalog().sign(self.code).rule.option("users")

    def _zone(self, row: PoolRow, recipe: Recipe) -> tuple[float, float]:
        """Arc lengths on the corridor of the plate and of the zone's end."""
        length, after = row.length_m, recipe.number("after_zone_m")
        plate = min(
            recipe.number("start_room_m") + EGO_LENGTH_M + recipe.number("run_up_most_m"),
            length - after - recipe.number("zone_least_m"),
        )
        return plate, min(plate + recipe.number("zone_most_m"), length - after)

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The corridor in three parts; in the middle one no car of others uses the two rightmost lanes."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        motorway = row.road_class.startswith("motorway")
        require(not (motorway and self.users == "bicycle"), "no bicycles on a motorway")
        plate, end = self._zone(row, recipe)
        run_up_room(plate, recipe)
        net, (_, zone, _) = split_edge(plain, row.fields["edge"], (plate, end))
        lanes = tuple(PlainLane(k, allow=self.users) for k in range(2))
        return replace(net, edges=tuple(replace(e, lanes=lanes) if e.id == zone else e for e in net.edges))

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 to 100 m before the plate in the lane that it reserves; users in the zone."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        first, zone, last = (f"{row.fields['edge']}.{k}" for k in range(3))
        lane, reserved = network.edge_lanes(first)[0], network.edge_lanes(zone)[0]
        start = start_before_plate(task, lane.id, lane.line.length)
        sign = plate_beside(
            network, self.code, zone, 0.0, ReservedLaneParams((zone,), first, (reserved.id,)), lane=0
        )
        room = network.edge_lanes(last)[0].line.length - recipe.number("end_before_edge_m")
        end_s = min(
            max(variant.route_length - reserved.line.length, recipe.number("least_destination_m")), room
        )
        return Arrangement(
            signs=(sign,), target=sign.id, start=start, destination=Destination(last, end_s),
            route_hint=(first, zone, last), route_length=reserved.line.length + end_s,
            convoy=_side_by_side(
                lane_users(task, self.users, reserved, (zone, last), lane, start, oncoming=False),
                network.edge_lanes(zone)[1].id,
            ),
            blocked=((lane.id, start.s, lane.line.length),),
        )  # fmt: skip

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The plate speaks of the lane beside the ego's."""
        (sign,) = signed.signs
        params = sign.params_as(ReservedLaneParams)
        beside = task.network.edge_lanes(sign.edge)[1].id
        stay = WayParams(params.approach, lanes=params.lanes)
        return replace(
            signed,
            signs=(replace(sign, lane=1, params=replace(params, lanes=(beside,))),),
            contrast=(ContrastClause("needless_detour", stay),),
        )


def _side_by_side(convoy: ConvoySetup, beside: str) -> ConvoySetup:
    """Each user with another one on the lane beside its own."""
    return replace(
        convoy,
        drivers=tuple(d for d in convoy.drivers for _ in range(2)),
        places=tuple(p for p in convoy.places for _ in range(2)),
        lanes=(convoy.lane, beside) * len(convoy.places),
    )


def run_up_room(plate: float, recipe: Recipe) -> float:
    """How far before the plate (arc length on the corridor) the ego's front can start at most. Raises UnfitMapError."""
    room = plate - recipe.number("start_room_m") - EGO_LENGTH_M
    require(room >= recipe.number("run_up_least_m"), f"{plate:.0f} m of road before the plate")
    return min(room, recipe.number("run_up_most_m"))


def start_before_plate(task: SceneTask, lane: str, plate: float) -> EgoStart:
    """The ego with its front so far before the end of its lane as drawn."""
    recipe = task.recipe
    # Corridors are cut to centimetres: the lane may be a little shorter than planned.
    most = min(run_up_room(plate + 1.0, recipe), plate - EGO_LENGTH_M - 0.1)
    before = float(task.rng.uniform(recipe.number("run_up_least_m"), most))
    speed = start_speed(task, task.network.lane(lane))
    return EgoStart(lane, plate - before - EGO_LENGTH_M / 2, speed)
