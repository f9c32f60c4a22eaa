"""What a picture consists of, whatever it is painted with. Units: m, rad, in the network's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tsbench.geometry.polyline import Array, Polyline
from tsbench.signs.countries import Country


@dataclass(frozen=True, slots=True)
class Area:
    """A filled surface. colour: a field of `Style`, which names what it is; polygon: any number of them, with holes."""

    colour: str
    polygon: shapely.Geometry
    opacity: float = 1.0


@dataclass(frozen=True, slots=True)
class Line:
    """An open line: (n, 2) points; width in m."""

    colour: str
    points: Array
    width: float


@dataclass(frozen=True, slots=True)
class Body:
    """Something that stands or drives: its centre, heading and size.

    kind: car, bus, bicycle, pedestrian, convoy, ego, cones or island, each of the first six a field of `Style`.
    signals: 1 = its left side flashes, -1 = its right side. brakes: do its brake lights shine?
    """

    kind: str
    name: str
    x: float
    y: float
    heading: float
    length: float
    width: float
    signals: int = 0
    brakes: bool = False


@dataclass(frozen=True, slots=True)
class DrawnPlate:
    """A traffic sign at its post. heading: of the traffic that it faces.

    away: unit vector in the picture (rows grow downwards) that leads off the road; clear: distance to the kerb.
    country: as `plate_rgba` has it. below: name of the main road's shape beneath it (`MainRoad.key`), "" = none.
    """

    name: str
    role: str
    code: str
    value: float | None
    x: float
    y: float
    heading: float
    away: Array
    clear: float
    target: bool
    country: Country | None = None
    below: str = ""


Shape = Area | Line | Body | DrawnPlate


def dashes(points: Array, dash: float, gap: float) -> list[Array]:
    """Pieces of a line (n, 2), each (m, 2)."""
    line = Polyline(points)
    starts = np.arange(0.0, max(line.length - dash / 2, 0.01), dash + gap)
    return [
        line.slice(s, min(s + dash, line.length)).points for s in starts.tolist() if s + 0.01 < line.length
    ]


def cone_places(cones: Body) -> Array:
    """(n, 2): where the cones of a row stand."""
    along = np.linspace(-0.5, 0.5, max(round(cones.length / 1.5), 2)) * (cones.length - 0.4)
    return np.column_stack((cones.x + along * np.cos(cones.heading), cones.y + along * np.sin(cones.heading)))
