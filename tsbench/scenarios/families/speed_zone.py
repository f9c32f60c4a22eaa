"""Speed scenes: a plate that binds the speed, on a straight corridor. Source: spec/scenes.md, "Speed"."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.maps.network import RoadNetwork
from tsbench.maps.plain import PlainNet
from tsbench.maps.pool import PoolRow
from tsbench.scenarios.elements import obey_element
from tsbench.scenarios.families.base import Arrangement, SceneTask, beside_road, passenger_lanes, require
from tsbench.scenarios.families.corridor import split_edge
from tsbench.scenarios.recipe import Recipe
from tsbench.scenarios.seeds import seed_of
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Destination, EgoStart
from tsbench.sim.world import EGO_LENGTH_M

KMH = 1.0 / 3.6


def posted_limit(row: PoolRow, scenario_type: str, choices: Sequence[int], margin_kmh: float) -> int:
    """One of the values that the road allows, in equal shares by a stable hash of the map."""
    usable = [v for v in choices if v + margin_kmh <= row.speed_mps * 3.6 + 0.5]
    require(bool(usable), f"the road's own limit is {row.speed_mps * 3.6:.0f} km/h")
    return usable[seed_of("limit", scenario_type, row.map_id) % len(usable)]


class SpeedZonePlacement:
    """`speed_limit`: 3.24 ahead of a driver who is too fast for it, 3.25 shortly before the destination."""

    def __init__(self, recipe: Recipe) -> None:
        self.code = recipe.type.codes[0]

    def _zone(self, row: PoolRow, recipe: Recipe) -> tuple[float, float]:
        """Arc lengths of plate and end plate on the corridor."""
        length = row.length_m
        end = length - recipe.number("end_before_edge_m") - recipe.number("end_plate_before_destination_m")
        plate = min(end - recipe.number("zone_m"), recipe.number("plate_at_most_m"))
        require(plate >= recipe.number("plate_at_least_m"), f"the corridor is {length:.0f} m long")
        return plate, end

    def prepare(self, row: PoolRow, plain: PlainNet, recipe: Recipe) -> PlainNet:
        """The corridor in three parts, so that other traffic can be bound in the middle one."""
        posted_limit(row, recipe.type.id, recipe.choices["limits_kmh"], recipe.number("below_road_kmh"))
        return split_edge(plain, row.fields["edge"], self._zone(row, recipe))[0]

    def arrange(self, task: SceneTask) -> Arrangement:
        """The ego so far before the plate that 3.5 m/s2 after half a second suffices."""
        row, network, recipe, variant = task.row, task.network, task.recipe, task.variant
        limit = posted_limit(
            row, recipe.type.id, recipe.choices["limits_kmh"], recipe.number("below_road_kmh")
        )
        v = limit * KMH
        edge = row.fields["edge"]
        first, zone, last = (f"{edge}.{k}" for k in range(3))
        lanes = passenger_lanes(network, first)
        lane = lanes[variant.layout % len(lanes)]
        excess = max(recipe.number("least_excess_mps"), variant.initial_speed)
        v0 = min(v + excess, v + recipe.number("most_excess_kmh") * KMH, row.speed_mps)
        need = (v0 * v0 - v * v) / (2 * recipe.number("brake_mps2")) + 0.5 * v0 + 3.0
        room = lane.line.length - need - EGO_LENGTH_M
        require(room >= 0.0, f"no room to brake from {v0:.1f} m/s before the plate")
        jitter = float(task.rng.uniform(0.0, min(recipe.number("jitter_m"), room)))
        start = EgoStart(lane.id, lane.line.length - need - jitter - EGO_LENGTH_M / 2, v0)
        end_lane = network.edge_lanes(last)[0]
        end_s = recipe.number("end_plate_before_destination_m")
        require(end_s < end_lane.line.length - 3.0, "no room for the destination")
        signs = (
            self._plate(network, "sign_0", self.code, zone, float(limit), {"zone_edges": f"{zone} {last}"}),
            self._plate(network, "sign_1", "3.25", last, float(limit), {}),
        )
        share = float(task.rng.uniform(recipe.number("obey_least"), recipe.number("obey_most")))
        factors = [
            1.0 if k < share * len(task.drivers) else row.speed_mps / v for k in range(len(task.drivers))
        ]
        return Arrangement(
            signs=signs, target="sign_0", start=start, destination=Destination(last, end_s),
            route_hint=(first, zone, last), route_length=network.edges[zone].length + end_s,
            extra=(obey_element([zone], network, v),), speed_factors=tuple(factors),
        )  # fmt: skip

    @staticmethod
    def _plate(
        network: RoadNetwork, sign_id: str, code: str, edge: str, value: float, params: dict[str, str]
    ) -> SignInstance:
        x, y, heading = beside_road(network, edge, 0.0)
        role, ends = ("target", None) if params else ("end", "sign_0")
        return SignInstance(sign_id, code, value, edge, -1, 0.0, x, y, heading, role, ends, params)
