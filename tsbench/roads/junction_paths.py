"""Paths through a junction and where they conflict: one for rules, experts and the makers of scenes. Units: m.

Source: docs/rules.md, "Geometry": a conflict zone is the overlap of the strips swept along two paths. Used when
a scene is loaded, never in a tick.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tsbench.core.errors import InputError
from tsbench.geometry.overlap import ConflictZone, conflict_zones
from tsbench.geometry.polyline import Polyline, join
from tsbench.roads.network import Connection, Lane, RoadNetwork


@dataclass(frozen=True, slots=True)
class JunctionPath:
    """One connection's way through the junction: from its line (s = 0) to the first ordinary edge.

    width: of its widest internal lane.
    """

    connection: Connection
    source: Lane
    target: Lane
    inner: tuple[Lane, ...]
    line: Polyline
    width: float

    def onto_exit(self, distance: float) -> Polyline:
        """The line with the first `distance` metres of the lane that it leads to."""
        exit_line = self.target.line
        return join([self.line, exit_line.slice(0.0, min(distance, exit_line.length))])


def junction_path(network: RoadNetwork, connection: Connection) -> JunctionPath:
    """The path of one connection. Raises InputError for a network without internal lanes."""
    lanes = network.lanes
    source, inner = lanes[connection.from_lane], tuple(lanes[v] for v in connection.via)
    if not inner:
        raise InputError(f"edge {source.edge!r}: a connection without internal lanes (rebuild the network)")
    line, width = join([v.line for v in inner]), max(v.width for v in inner)
    return JunctionPath(connection, source, lanes[connection.to_lane], inner, line, width)


def junction_paths(network: RoadNetwork, edges: Iterable[str]) -> tuple[JunctionPath, ...]:
    """The paths from all lanes of some edges: by edge as given, lanes from the kerb on, connections in file order."""
    return tuple(
        junction_path(network, connection)
        for edge in edges
        for lane in network.edges[edge].lanes
        for connection in network.outgoing[lane]
    )


def path_zones(
    paths: Sequence[JunctionPath],
    others: Sequence[JunctionPath],
    *,
    width: float | None = None,
    least_overlap: float = 0.0,
) -> tuple[tuple[ConflictZone | None, ...], ...]:
    """[k][j]: where `paths[k]` (a) and `others[j]` (b) conflict.

    width: of every strip; None: each is as wide as its lanes. least_overlap: where strips overlap by less, there is no
    zone: those of neighbouring lanes that turn apart do so by a few centimetres, where no vehicles meet.
    """
    own, met = ([(p.line, p.width if width is None else width) for p in side] for side in (paths, others))
    return conflict_zones(own, met, min_depth=least_overlap)
