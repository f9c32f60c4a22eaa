"""Lane paths through a junction and their conflict zones, computed once for a scene. Units: m.

Source: docs/spec/rules.md, "Geometry": a zone is the overlap of the strips swept by two lane paths.
"""

from __future__ import annotations

from dataclasses import dataclass

from tsbench.errors import InputError
from tsbench.geometry.overlap import ConflictZone, conflict_zones
from tsbench.geometry.polyline import Polyline, join
from tsbench.maps.network import Connection, RoadNetwork

# Strips of neighbouring lanes that turn apart overlap by a few centimetres, where nobody meets anybody.
_SLIVER_M = 0.5


@dataclass(frozen=True, slots=True)
class JunctionPath:
    """One connection's way through the junction: from its line (s = 0) to the first ordinary edge."""

    connection: Connection
    source: str
    target: str
    line: Polyline
    width: float


def junction_paths(network: RoadNetwork, edge: str) -> tuple[JunctionPath, ...]:
    """The paths from all lanes of an edge, in file order."""
    paths = []
    for lane in network.edges[edge].lanes:
        for connection in network.outgoing[lane]:
            inner = [network.lanes[v] for v in connection.via]
            if not inner:
                raise InputError(f"edge {edge!r}: a connection without internal lanes (rebuild the network)")
            paths.append(
                JunctionPath(
                    connection=connection,
                    source=edge,
                    target=network.lanes[connection.to_lane].edge,
                    line=join([v.line for v in inner]),
                    width=max(v.width for v in inner),
                )
            )
    return tuple(paths)


def zones(
    paths: tuple[JunctionPath, ...], others: tuple[JunctionPath, ...]
) -> tuple[tuple[ConflictZone | None, ...], ...]:
    """[k][j]: where `paths[k]` (a) and `others[j]` (b) conflict."""
    return conflict_zones(
        [(p.line, p.width) for p in paths], [(p.line, p.width) for p in others], min_depth=_SLIVER_M
    )
