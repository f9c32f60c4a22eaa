"""A lane for buses or cyclists in the ego's own direction, where the ego drives.

Source: docs/scenes.md, "Reserved lanes". Units: m.
"""

from __future__ import annotations

from dataclasses import replace

from lxml import etree

from tsbench.geometry.polyline import Polyline
from tsbench.make.maps.plain import PlainLane, PlainNet, split_edge
from tsbench.make.placements.lane_users import user_driver
from tsbench.make.placements.placement import (
    Arrangement,
    ScenePlacement,
    SceneTask,
    UnfitMapError,
    exchanged,
    plate_beside,
    require,
    start_speed,
    usual_limit,
)
from tsbench.make.scenes.elements import moving_vehicle
from tsbench.make.scenes.recipe import Recipe
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import Lane
from tsbench.scenarios.map_pool import PoolRow
from tsbench.signs.contrast import ContrastClause, WayParams
from tsbench.signs.plate_params import ReservedLaneParams
from tsbench.sim.scene import EgoStart
from tsbench.sim.world import EGO_LENGTH_M


class ReservedLanePlacement(ScenePlacement):
    """`bus_lane`, `bike_lane`: from the plate on the rightmost lane is for others, to the end of the marked zone.

    A second post stands on the other side of the road and faces oncoming traffic, whose rightmost lane it may reserve.
    The halves exchange the two posts' plates, a reserved lane and a usual limit. Users drive on the oncoming lane
    alone, and no other vehicle drives on either lane: which one is theirs, only the plates say.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]
        self.users = recipe.catalog.sign(self.code).rule.option("users")

    def _zone(self, row: PoolRow, recipe: Recipe) -> tuple[float, float]:
        """Arc lengths on the corridor of the plate and of the zone's end."""
        length, after = row.length_m, recipe.number("after_zone_m")
        plate = min(
            recipe.number("start_room_m") + EGO_LENGTH_M + recipe.number("run_up_most_m"),
            length - after - recipe.number("zone_least_m"),
        )
        return plate, min(plate + recipe.number("zone_most_m"), length - after)

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """Both directions in three parts; in the middle ones no car of others uses the rightmost lane."""
        require(row.lanes >= recipe.number("least_lanes"), f"{row.lanes} lanes")
        motorway = row.road_class.startswith("motorway")
        require(not (motorway and self.users == "bicycle"), "no bicycles on a motorway")
        other = next((e for e in plain.edges if e.id == row.fields.get("opposite")), None)
        if other is None:
            raise UnfitMapError("no other direction, where the other half's plate faces")
        require(other.num_lanes >= recipe.number("least_lanes"), f"{other.num_lanes} oncoming lanes")
        plate, end = self._zone(row, recipe)
        run_up_room(plate, recipe)
        road = Polyline(next(e.shape for e in plain.edges if e.id == row.fields["edge"]))
        beside = plate - recipe.number("facing_before_plate_m")
        ends = beside, max(beside - recipe.number("zone_most_m"), recipe.number("least_destination_m"))
        line = Polyline(other.shape)
        net, (_, zone, _) = split_edge(plain, row.fields["edge"], (plate, end))
        cuts = [line.project(*road.point_at(s))[0] for s in ends]
        require(0.0 < cuts[0] < cuts[1] < line.length, "the two directions do not run side by side")
        net, (_, facing, _) = split_edge(net, other.id, cuts)
        lanes = (PlainLane(0, allow=self.users),)
        edges = (replace(e, lanes=lanes) if e.id in (zone, facing) else e for e in net.edges)
        return replace(net, edges=tuple(edges))

    def place(self, task: SceneTask) -> Arrangement:
        """The ego 60 to 100 m before the plate in the lane that it reserves; users come towards it."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        first, zone, last = (f"{row.fields['edge']}.{k}" for k in range(3))
        facing, beyond = (f"{row.fields['opposite']}.{k}" for k in (1, 2))
        lane, reserved = network.edge_lanes(first)[0], network.edge_lanes(zone)[0]
        start = start_before_plate(task, lane.id, lane.line.length)
        sign = plate_beside(network, self.code, zone, 0.0, ReservedLaneParams((zone,), first, (reserved.id,)), lane=0)
        other = usual_limit(task, recipe.choices["harmless"][0], (facing, 0.0), (facing, zone))
        room = network.edge_lanes(last)[0].line.length - recipe.number("end_before_edge_m")
        end_s = variant.route_end(recipe.number("least_destination_m"), room)
        return Arrangement(
            signs=(sign, other),
            target=sign.id,
            start=start,
            destination=Destination(last, end_s),
            route_hint=(first, zone, last),
            route_length=reserved.line.length + end_s,
            extra=_users(task, self.users, network.edge_lanes(facing)[0], (facing, beyond)),
            blocked=((lane.id, start.s, lane.line.length),),
        )

    def contrast(self, task: SceneTask, signed: Arrangement) -> Arrangement:
        """The two plates exchanged: the oncoming lane is reserved, and the ego stays in its own."""
        del task
        plate, other = signed.signs
        params = plate.params_as(ReservedLaneParams)
        stay = ContrastClause("needless_detour", WayParams(params.approach, lanes=params.lanes))
        return replace(signed, target=other.id, signs=exchanged(plate, other), contrast=(stay,))


def _users(task: SceneTask, vclass: str, lane: Lane, edges: tuple[str, ...]) -> tuple[etree._Element, ...]:
    """Buses or cyclists on the oncoming lane, a headway from each other, the last near its beginning."""
    driver, counts = user_driver(task.recipe), task.recipe.choices["users"]
    asked = int(counts[task.variant.layout % len(counts)])
    first = driver.length + float(task.rng.uniform(0.0, task.recipe.number("user_jitter_m")))
    step = max(driver.speed * task.recipe.number("user_headway_s"), driver.length + driver.gap)
    places = [first + k * step for k in range(asked)]
    elements: list[etree._Element] = []
    for k, s in enumerate(p for p in places if p < lane.line.length - 1.0):
        place = s * lane.length / lane.line.length
        elements += moving_vehicle(f"user_{k}", driver, vclass, lane.order, place, edges)
    return tuple(elements)


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
