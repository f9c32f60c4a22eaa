"""Plate 8.13: where the main road leads at a junction where it turns. It hangs beneath the plates of priority there.

No scene file names it: which roads are the main one follows from the plates 2.1 that stand before the junction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tsbench.roads.network import RoadNetwork
from tsbench.signs.annotations import SignInstance

CODE = "8.13"
MAIN, GIVE_WAY, STOP = frozenset({"2.1", "2.3.1", "2.3.2", "2.3.3"}), frozenset({"2.4"}), frozenset({"2.5"})
_BELOW = frozenset({"2.1", "2.4", "2.5"})
# Main arms that lie opposite each other, give or take so much, are a road that goes straight on.
_STRAIGHT_DEG, _SAME_ARM_DEG, _STEP_DEG = 45.0, 25.0, 15


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

    @property
    def told(self) -> tuple[float, float]:
        """What planners are told of it: `main` in rad, the rightmost first."""
        one, other = sorted(self.main)
        return math.radians(one), math.radians(other)


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
