"""A junction as an expert sees it: the ego's own way through, where others' paths meet it, and which vehicles go first.

Units: m.
"""

from __future__ import annotations

from dataclasses import dataclass

from tsbench.geometry.overlap import ConflictZone
from tsbench.planners.base import Privilege
from tsbench.roads.junction_paths import JunctionPath, junction_path, junction_paths, path_zones
from tsbench.roads.lane_graph import RoutePath
from tsbench.roads.network import RoadNetwork

# As wide as bodies with some room.
_BODY_M = 2.4


@dataclass(frozen=True, slots=True)
class WayThrough:
    """The ego's own way through: arc length of its line on its route, zone with each path of the others.

    first: the paths whose vehicles go before the ego, by a plate or by the network's right of way.
    """

    line_s: float
    zones: tuple[ConflictZone | None, ...]
    first: frozenset[int]

    @property
    def end_s(self) -> float:
        """Arc length on the route where the last zone ends."""
        return self.line_s + max((z.a_out for z in self.zones if z is not None), default=0.0)


def paths_through(network: RoadNetwork, approach: str, but: tuple[str, ...] = ()) -> tuple[JunctionPath, ...]:
    """The paths through the junction at the end of `approach` from its other approaches, save some."""
    junction, left_out = network.edges[approach].target, {approach, *but}
    edges = (e.id for e in network.edges.values() if e.target == junction and not e.internal)
    return junction_paths(network, (e for e in edges if e not in left_out))


def crossing(
    privilege: Privilege, path: RoutePath, approach: str, others: tuple[JunctionPath, ...], ruled: int = 0
) -> WayThrough | None:
    """Where a route passes the junction from `approach` (SUMO's edge); None where it does not (any more).

    ruled: so many of the others' paths, the first ones, have priority by a plate: there strips are as wide as their
    lanes, as the rule has them, else as wide as bodies with some room. However little they overlap, they conflict:
    an expert is careful already where the rule sees no zone yet.
    """
    network, view = privilege.network, privilege.view
    edge, lanes = view.on_edge(approach)[0], view.map.lanes
    on_it = [lanes[piece.lane].edge == edge for piece in path.pieces] + [False]
    if True not in on_it:
        return None
    at = on_it.index(False, on_it.index(True)) - 1
    if at + 1 == len(path.pieces) or path.pieces[at + 1].lane not in view.crossed:
        return None
    taken = junction_path(network, view.crossed[path.pieces[at + 1].lane])
    by_plate = path_zones((taken,), others[:ruled])[0]
    by_body = path_zones((taken,), others[ruled:], width=_BODY_M)[0]
    prior = taken.connection.yields_to
    return WayThrough(
        line_s=path.pieces[at].s1,
        zones=(*by_plate, *by_body),
        first=frozenset(k for k, other in enumerate(others) if k < ruled or not prior.isdisjoint(other.connection.via)),
    )
