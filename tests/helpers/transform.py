"""The same scene seen elsewhere: mirrored at the x axis, then turned, then shifted."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance
from tsbench.sim.scene import Obstacle


@dataclass(frozen=True)
class Transform:
    """angle in rad, dx and dy in m."""

    mirror: bool = False
    angle: float = 0.0
    dx: float = 0.0
    dy: float = 0.0

    def points(self, xy: Array) -> Array:
        """(k, 2) points."""
        x, y = xy[:, 0], -xy[:, 1] if self.mirror else xy[:, 1]
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.column_stack((c * x - s * y + self.dx, s * x + c * y + self.dy))

    def pose(self, x: float, y: float, heading: float) -> tuple[float, float, float]:
        """A pose."""
        px, py = self.points(np.array([[x, y]]))[0].tolist()
        return px, py, (-heading if self.mirror else heading) + self.angle

    def line(self, line: Polyline) -> Polyline:
        """A polyline."""
        return Polyline(self.points(line.points))

    def network(self, network: RoadNetwork) -> RoadNetwork:
        """A network; under a mirror lanes change sides, their numbers stay."""
        lanes = tuple(
            replace(
                lane,
                line=self.line(lane.line),
                left=lane.right if self.mirror else lane.left,
                right=lane.left if self.mirror else lane.right,
            )
            for lane in network.lanes
        )
        junctions = {}
        for key, junction in network.junctions.items():
            x, y, _ = self.pose(junction.x, junction.y, 0.0)
            area = self.points(junction.polygon) if len(junction.polygon) else junction.polygon
            junctions[key] = replace(junction, x=x, y=y, polygon=area)
        crossings = {k: replace(c, line=self.line(c.line)) for k, c in network.crossings.items()}
        return replace(network, lanes=lanes, junctions=junctions, crossings=crossings)

    def sign(self, sign: SignInstance) -> SignInstance:
        """A plate."""
        x, y, heading = self.pose(sign.x, sign.y, sign.heading)
        return replace(sign, x=x, y=y, heading=heading)

    def obstacle(self, o: Obstacle) -> Obstacle:
        """An obstacle."""
        x, y, heading = self.pose(o.x, o.y, o.heading)
        return replace(o, x=x, y=y, heading=heading)
