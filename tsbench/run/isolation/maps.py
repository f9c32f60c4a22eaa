"""Maps and routes as messages. The reader gets the numbers of the writer, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from itertools import chain
from types import MappingProxyType
from typing import Any

import numpy as np

from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.lane_graph import PathPiece, RoutePath
from tsbench.roads.network import Connection, Edge, Junction, Lane, RoadNetwork
from tsbench.roads.road_map import Crossing, MapConnection, MapEdge, MapJunction, MapLane, RoadMap
from tsbench.run.isolation.protocol import MessageKind, ProtocolError, lines, names, pack, unpack


def map_message(roads: RoadMap) -> bytes:
    lanes, edges = roads.lanes, list(roads.edges.values())
    junctions, crossings = list(roads.junctions.values()), list(roads.crossings.values())
    return pack(
        MessageKind.MAP,
        lines([lane.id for lane in lanes]), lines([lane.edge for lane in lanes]),
        [(lane.order, lane.internal, lane.left, lane.right) for lane in lanes],
        [(lane.width, lane.speed) for lane in lanes],
        *_flat([lane.line.points for lane in lanes]),
        lines([*(e.id for e in edges), *(e.source for e in edges), *(e.target for e in edges)]),
        [(len(e.lanes), e.internal) for e in edges], list(chain(*(e.lanes for e in edges))), [e.length for e in edges],
        [(c.from_lane, c.to_lane, len(c.via)) for c in roads.connections],
        list(chain(*(c.via for c in roads.connections))),
        lines([j.id for j in junctions]), [(j.x, j.y) for j in junctions], *_flat([j.polygon for j in junctions]),
        lines([c.id for c in crossings]), lines([" ".join(c.edges) for c in crossings]),
        [c.width for c in crossings], *_flat([c.line.points for c in crossings]),
        json.dumps(_of_sumo(roads)) if isinstance(roads, RoadNetwork) else "",
    )  # fmt: skip


def _of_sumo(network: RoadNetwork) -> dict[str, Any]:
    return {
        "lanes": [(lane.length, sorted(lane.allow), sorted(lane.disallow)) for lane in network.lanes],
        "edges": [(edge.priority, edge.road_class) for edge in network.edges.values()],
        "connections": [(c.direction, c.state, sorted(c.yields_to)) for c in network.connections],
        "junctions": [junction.type for junction in network.junctions.values()],
        "class_speed": dict(network.class_speed),
    }


def read_map(body: bytes) -> RoadMap:
    """The map of a message; SUMO's own network where it tells that."""
    (
        lane_ids, lane_edges, lane_places, lane_sizes, lane_counts, lane_points, edge_names, edge_counts, edge_lanes,
        edge_lengths, link_counts, link_via, junction_ids, middles, junction_counts, junction_points, crossing_ids,
        crossing_edges, crossing_widths, crossing_counts, crossing_points, sumo,
    ) = unpack(MessageKind.MAP, body)  # fmt: skip
    n, e, j, k = len(lane_counts), len(edge_lengths), len(junction_counts), len(crossing_counts)
    more = json.loads(sumo) if sumo else None
    ids, own_edges = names(lane_ids, n), names(lane_edges, n)
    rows = zip(
        lane_places.reshape(n, 4).tolist(), lane_sizes.reshape(n, 2).tolist(), _parts(lane_points, lane_counts),
        strict=True,
    )  # fmt: skip
    lanes: list[MapLane] = []
    for i, ((order, internal, left, right), (width, speed), points) in enumerate(rows):
        own = (
            i, ids[i], own_edges[i], order, Polyline(points), width, speed, bool(internal), left, right
        )  # fmt: skip
        if more is None:
            lanes.append(MapLane(*own))
        else:
            length, allow, disallow = more["lanes"][i]
            lanes.append(Lane(*own, length=length, allow=frozenset(allow), disallow=frozenset(disallow)))
    words = names(edge_names, 3 * e)
    counts = edge_counts.reshape(e, 2).tolist()
    edges: dict[str, MapEdge] = {}
    for i, own_lanes in enumerate(_runs(edge_lanes, [count for count, _ in counts])):
        one = (
            words[i], words[e + i], words[2 * e + i], tuple(own_lanes), bool(counts[i][1]), float(edge_lengths[i])
        )  # fmt: skip
        edges[words[i]] = (
            MapEdge(*one)
            if more is None
            else Edge(*one, priority=more["edges"][i][0], road_class=more["edges"][i][1])
        )
    links = link_counts.reshape(-1, 3).tolist()
    connections: list[MapConnection] = []
    for i, via in enumerate(_runs(link_via, [count for *_, count in links])):
        ends = (links[i][0], links[i][1], tuple(via))
        if more is None:
            connections.append(MapConnection(*ends))
        else:
            direction, state, yields_to = more["connections"][i]
            connections.append(Connection(*ends, direction, state, frozenset(yields_to)))
    outgoing: list[list[MapConnection]] = [[] for _ in lanes]
    for connection in connections:
        outgoing[connection.from_lane].append(connection)
    junctions: dict[str, MapJunction] = {}
    for i, (name, (x, y), area) in enumerate(
        zip(
            names(junction_ids, j), middles.reshape(j, 2).tolist(), _parts(junction_points, junction_counts),
            strict=True,
        )
    ):  # fmt: skip
        place = (name, x, y, area)
        junctions[name] = MapJunction(*place) if more is None else Junction(*place, type=more["junctions"][i])
    crossed = zip(
        names(crossing_ids, k), names(crossing_edges, k), _parts(crossing_points, crossing_counts),
        crossing_widths.tolist(), strict=True,
    )  # fmt: skip
    crossings = {
        name: Crossing(name, tuple(roads.split()), Polyline(points), width)
        for name, roads, points, width in crossed
    }
    whole: dict[str, Any] = {
        "lanes": tuple(lanes), "lane_index": MappingProxyType({lane.id: lane.index for lane in lanes}),
        "edges": MappingProxyType(edges), "junctions": MappingProxyType(junctions),
        "connections": tuple(connections), "outgoing": tuple(map(tuple, outgoing)),
        "crossings": MappingProxyType(crossings),
    }  # fmt: skip
    return RoadMap(**whole) if more is None else RoadNetwork(**whole, class_speed=more["class_speed"])


def route_message(path: RoutePath) -> bytes:
    return pack(
        MessageKind.ROUTE, lines(path.edges), path.line.points, [p.lane for p in path.pieces],
        [(p.s0, p.s1) for p in path.pieces], np.column_stack((path.limit_s, path.limit)), [path.destination_s],
    )  # fmt: skip


def read_route(body: bytes) -> RoutePath:
    edges, points, piece_lanes, pieces, limits, destination = unpack(MessageKind.ROUTE, body)
    ends, steps = pieces.reshape(-1, 2).tolist(), limits.reshape(-1, 2)
    return RoutePath(
        tuple(edges.split("\n")) if edges else (), Polyline(points.reshape(-1, 2)),
        tuple(PathPiece(s0, s1, lane) for (s0, s1), lane in zip(ends, piece_lanes.tolist(), strict=True)),
        fixed(steps[:, 0]), fixed(steps[:, 1]), float(destination[0]),
    )  # fmt: skip


def fixed(array: Any) -> Any:
    """An own, contiguous array that nobody can write into."""
    own = array.copy()
    own.setflags(write=False)
    return own


def _flat(parts: Sequence[Array]) -> tuple[list[int], Array]:
    return [len(part) for part in parts], np.concatenate([*parts, np.empty((0, 2))])


def _parts(points: Array, counts: Any) -> list[Array]:
    pairs = points.reshape(-1, 2)
    ends = np.cumsum(counts).tolist()
    if (ends[-1] if ends else 0) != len(pairs):
        raise ProtocolError("points do not add up")
    return [fixed(pairs[a:b]) for a, b in zip([0, *ends], ends, strict=False)]


def _runs(values: Any, counts: Iterable[int]) -> list[list[int]]:
    whole, at, found = values.tolist(), 0, []
    for count in counts:
        found.append(whole[at : at + count])
        at += count
    return found
