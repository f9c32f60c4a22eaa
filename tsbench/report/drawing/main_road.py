"""Plate 8.13: where the main road leads at a junction where it turns. Drawn beneath the plates of priority there.

It is no part of a scene: which roads are the main one is read from the plates 2.1 that stand before the junction.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from PIL import Image as PilImage
from resvg_py import svg_to_bytes

from tsbench.report.drawing.canvas import Image
from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance

CODE = "8.13"
MAIN, GIVE_WAY, STOP = frozenset({"2.1", "2.3.1", "2.3.2", "2.3.3"}), frozenset({"2.4"}), frozenset({"2.5"})
_BELOW = frozenset({"2.1", "2.4", "2.5"})
# Main arms that lie opposite each other, give or take so much, are a road that goes straight on.
_STRAIGHT_DEG, _SAME_ARM_DEG, _STEP_DEG = 45.0, 25.0, 15
_MAIN_PX, _OTHER_PX, _REACH_PX = 30, 11, 78


@dataclass(frozen=True, slots=True)
class MainRoad:
    """Roads as they lead from a junction's middle, in degrees to the left of straight on; who looks comes from 180."""

    main: tuple[int, int]
    others: tuple[int, ...]

    @property
    def key(self) -> str:
        """A name for it, `8.13|MAIN,MAIN|OTHER,…`."""
        return "|".join((CODE, *(",".join(map(str, part)) for part in (self.main, self.others))))

    @classmethod
    def of(cls, key: str) -> MainRoad:
        """By its name. Raises ValueError for one that names none."""
        code, *parts = key.split("|")
        if code != CODE or len(parts) != 2:
            raise ValueError(f"{key!r} is no main road: {CODE}|MAIN,MAIN|OTHER,…")
        one, other = (int(word) for word in parts[0].split(","))
        return cls((one, other), tuple(int(word) for word in parts[1].split(",") if word))

    def svg(self) -> str:
        """The plate as an SVG document of 200 x 200 units."""
        return (
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200"><title>8.13 Main road\'s direction</title>'
            '<rect x="3" y="3" width="194" height="194" rx="12" fill="#ffffff" stroke="#1a1a1a" stroke-width="6"/>'
            '<g fill="none" stroke="#1a1a1a" stroke-linejoin="round">'
            f"{''.join(_way((angle,), _OTHER_PX) for angle in self.others)}{_way(self.main, _MAIN_PX)}</g></svg>"
        )


def _way(angles: Sequence[int], width: int) -> str:
    """A road through the middle (two angles), or to it (one)."""
    ends = [
        (100 - _REACH_PX * math.sin(math.radians(a)), 100 - _REACH_PX * math.cos(math.radians(a)))
        for a in angles
    ]
    points = [ends[0], (100.0, 100.0), *ends[1:]]
    return f'<polyline stroke-width="{width}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'


@lru_cache(maxsize=256)
def main_road_rgba(key: str, size_px: int) -> Image:
    """The plate of a name, read-only (size_px, size_px, 4), RGB with straight alpha."""
    png = svg_to_bytes(
        svg_string=MainRoad.of(key).svg(), width=size_px, height=size_px, skip_system_fonts=True
    )
    with PilImage.open(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"))
    pixels.setflags(write=False)
    return pixels


def main_roads(network: RoadNetwork, signs: Sequence[SignInstance]) -> dict[str, MainRoad]:
    """By id of a plate of priority: what 8.13 beneath it shows, where the main road turns at its junction."""
    found = {}
    for sign in signs:
        junction = network.edges[sign.edge].target
        main = {s.edge for s in signs if s.code == "2.1" and network.edges[s.edge].target == junction}
        if sign.code not in _BELOW or len(main) != 2:
            continue
        one, other = (_inbound(network, edge) + 180.0 for edge in sorted(main))
        if abs(_turn(one - other)) > 180.0 - _STRAIGHT_DEG:
            continue
        ahead = _inbound(network, sign.edge)
        arms = [one, other]
        for arm in _arms(network, junction):
            if all(abs(_turn(arm - known)) > _SAME_ARM_DEG for known in arms):
                arms.append(arm)
        first, second, *others = (_rounded(arm - ahead) for arm in arms)
        found[sign.id] = MainRoad((first, second), tuple(sorted(others)))
    return found


def _arms(network: RoadNetwork, junction: str) -> Iterator[float]:
    """Directions of all roads as they lead from a junction, degrees."""
    for edge in network.edges.values():
        if edge.internal or not any(network.lanes[i].permits("passenger") for i in edge.lanes):
            continue
        if edge.target == junction:
            yield _inbound(network, edge.id) + 180.0
        if edge.source == junction:
            yield math.degrees(network.lanes[edge.lanes[0]].line.heading_at(0.0))


def _inbound(network: RoadNetwork, edge: str) -> float:
    """Where traffic of an edge drives at its end, degrees."""
    line = network.edge_lanes(edge)[0].line
    return math.degrees(line.heading_at(line.length))


def _turn(angle: float) -> float:
    return (angle + 180.0) % 360.0 - 180.0


def _rounded(angle: float) -> int:
    """To whole steps, in (-180, 180]."""
    steps = round(_turn(angle) / _STEP_DEG) * _STEP_DEG
    return 180 if steps == -180 else steps
