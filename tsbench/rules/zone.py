"""The zone of a plate along the road: from its own line to its end plate's or the end of the last edge.

Positions are metres from the start of an edge's lanes.
"""

from __future__ import annotations

from tsbench.core.errors import InputError
from tsbench.rules.monitor import Monitor
from tsbench.signs.annotations import SignInstance
from tsbench.signs.plate_params import ZoneParams
from tsbench.sim.world import EgoState


class Zone:
    """A stretch of road that a plate rules. start, end: m along `road`."""

    def __init__(self, monitor: Monitor) -> None:
        sign, scene = monitor.sign, monitor.scene
        edges = sign.params_as(ZoneParams).zone_edges
        where = f"{scene.additional}: sign {sign.id!r}"
        self.road = monitor.road(edges, sign.lane)
        self.start = sign.position_m
        self.end = self.road.length
        plate = _end_plate(sign, scene.signs)
        if plate is not None:
            if plate.edge not in self.road.starts:
                raise InputError(f"{where}: its end plate {plate.id!r} is not on an edge of its zone")
            self.end = self.road.starts[plate.edge] + plate.position_m
        if not self.start < self.end:
            raise InputError(f"{where}: its zone ends before it starts")

    def front(self, ego: EgoState) -> float | None:
        """Metres of the ego's front past the plate's line; None where it is outside the zone."""
        front = self.road.front(ego)
        return front - self.start if front is not None and self.start < front <= self.end else None


def _end_plate(sign: SignInstance, signs: tuple[SignInstance, ...]) -> SignInstance | None:
    return next((s for s in signs if s.ends == sign.id), None)
