"""nuPlan's map API over the map that every planner is given. Units: m, m/s, rad.

A roadblock is an edge, a lane connector the path of a connection through a junction; a roadblock connector holds all
connectors from one edge to another and is called "SOURCE>TARGET". Layers are known by their names (`layer.name`), so
nuPlan's own `SemanticMapLayer` or any enum with these names will do. Names follow nuplan-devkit 1.2
(`nuplan.common.maps.abstract_map`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
import shapely

from tsbench.adapters.nuplan.states import StateSE2
from tsbench.core.errors import InputError
from tsbench.geometry.polyline import Polyline, join
from tsbench.planners.geometry import lane_polygon
from tsbench.roads.road_map import Crossing, MapEdge, MapLane, RoadMap


class SemanticMapLayer(Enum):
    """The layers that there are here, by nuPlan's names and values."""

    LANE = 0
    INTERSECTION = 1
    CROSSWALK = 4
    LANE_CONNECTOR = 11
    ROADBLOCK = 17
    ROADBLOCK_CONNECTOR = 18


class _Place(Protocol):
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...


class PolylineMapObject:
    """A lane's middle line."""

    def __init__(self, line: Polyline) -> None:
        self.line = line

    @property
    def length(self) -> float:
        return self.line.length

    @cached_property
    def linestring(self) -> shapely.LineString:
        return shapely.LineString(self.line.points)

    @cached_property
    def discrete_path(self) -> list[StateSE2]:
        """The line's points with their headings."""
        at = self.line.s.tolist()
        return [
            StateSE2(x, y, self.line.heading_at(s))
            for (x, y), s in zip(self.line.points.tolist(), at, strict=True)
        ]

    def get_nearest_arc_length_from_position(self, point: _Place) -> float:
        s, _ = self.line.project(point.x, point.y)
        return min(max(s, 0.0), self.length)

    def get_nearest_pose_from_position(self, point: _Place) -> StateSE2:
        s = self.get_nearest_arc_length_from_position(point)
        return StateSE2(*self.line.point_at(s), self.line.heading_at(s))


class _Area:
    """Something with an id and an area."""

    id: str

    @property
    def polygon(self) -> shapely.Polygon:
        raise NotImplementedError

    def contains_point(self, point: _Place) -> bool:
        return bool(shapely.intersects_xy(self.polygon, point.x, point.y))


class LaneGraphEdge(_Area):
    """A lane or a lane connector. index: its place from the kerb on, as nuPlan's counts from the right."""

    def __init__(self, roads: NuPlanMap, lanes: tuple[MapLane, ...], roadblock: str) -> None:
        self._roads, self._roadblock = roads, roadblock
        self.lanes = lanes
        self.id = ">".join(lane.id for lane in lanes)
        self.index = lanes[0].order
        self.speed_limit_mps = min(lane.speed for lane in lanes)
        self.width = min(lane.width for lane in lanes)
        self.before: list[LaneGraphEdge] = []
        self.after: list[LaneGraphEdge] = []

    @cached_property
    def baseline_path(self) -> PolylineMapObject:
        lines = [lane.line for lane in self.lanes]
        return PolylineMapObject(lines[0] if len(lines) == 1 else join(lines))

    @cached_property
    def left_boundary(self) -> PolylineMapObject:
        return PolylineMapObject(Polyline(self.baseline_path.line.beside(self.width / 2)))

    @cached_property
    def right_boundary(self) -> PolylineMapObject:
        return PolylineMapObject(Polyline(self.baseline_path.line.beside(-self.width / 2)))

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.union_all([shapely.Polygon(lane_polygon(lane)).buffer(0) for lane in self.lanes])

    @property
    def incoming_edges(self) -> list[LaneGraphEdge]:
        return list(self.before)

    @property
    def outgoing_edges(self) -> list[LaneGraphEdge]:
        return list(self.after)

    @property
    def parent(self) -> RoadBlock:
        return self._roads.roadblock(self._roadblock)

    @property
    def parallel_edges(self) -> list[LaneGraphEdge]:
        return [lane for lane in self.parent.interior_edges if lane is not self]

    @property
    def adjacent_edges(self) -> tuple[LaneGraphEdge | None, LaneGraphEdge | None]:
        """(left, right): the lanes beside it that go the same way."""
        left, right = (self._roads.of_index(k) for k in (self.lanes[0].left, self.lanes[0].right))
        return left, right

    def get_roadblock_id(self) -> str:
        return self._roadblock

    def has_traffic_lights(self) -> bool:
        """There are none: scenes have no signals."""
        return False


class RoadBlock(_Area):
    """An edge, or all connectors between two edges. interior_edges: its lanes, from the kerb on."""

    def __init__(self, name: str, interior: list[LaneGraphEdge]) -> None:
        self.id = name
        self.interior_edges = interior

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.union_all([lane.polygon for lane in self.interior_edges])

    @property
    def incoming_edges(self) -> list[RoadBlock]:
        return _blocks(lane for inner in self.interior_edges for lane in inner.before)

    @property
    def outgoing_edges(self) -> list[RoadBlock]:
        return _blocks(lane for inner in self.interior_edges for lane in inner.after)


class Polygon(_Area):
    """A junction's area (INTERSECTION), or a place where people cross (CROSSWALK)."""

    def __init__(self, name: str, points: np.ndarray) -> None:
        self.id = name
        self._points = points

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.Polygon(self._points).buffer(0)


MapObject = LaneGraphEdge | RoadBlock | Polygon


def connector_name(source: str, target: str) -> str:
    """The id of the roadblock connector from one edge to another."""
    return f"{source}>{target}"


class NuPlanMap:
    """`AbstractMap` of one scene. Objects are made once; what asks for areas pays for them when it asks."""

    def __init__(self, network: RoadMap) -> None:
        self.map_name = "tsbench"
        self._network = network
        self._lanes: dict[int, LaneGraphEdge] = {}
        self._connectors: list[LaneGraphEdge] = []
        self._blocks: dict[str, RoadBlock] = {}
        self._joints: dict[str, RoadBlock] = {}
        for edge in network.edges.values():
            if not edge.internal:
                self._add_edge(edge)
        for connection in network.connections:
            a, b = self._lanes.get(connection.from_lane), self._lanes.get(connection.to_lane)
            if a is None or b is None:
                continue
            if not connection.via:
                _link(a, b)
                continue
            name = connector_name(a.get_roadblock_id(), b.get_roadblock_id())
            through = LaneGraphEdge(self, tuple(network.lanes[k] for k in connection.via), name)
            _link(a, through)
            _link(through, b)
            self._connectors.append(through)
            self._joints.setdefault(name, RoadBlock(name, [])).interior_edges.append(through)
        self._layers: dict[str, dict[str, MapObject]] = {
            "LANE": {lane.id: lane for lane in self._lanes.values()},
            "LANE_CONNECTOR": {lane.id: lane for lane in self._connectors},
            "ROADBLOCK": dict(self._blocks),
            "ROADBLOCK_CONNECTOR": dict(self._joints),
            "INTERSECTION": {
                j.id: Polygon(j.id, j.polygon) for j in network.junctions.values() if len(j.polygon) > 2
            },
            "CROSSWALK": {c.id: Polygon(c.id, _strip(c)) for c in network.crossings.values()},
        }

    def _add_edge(self, edge: MapEdge) -> None:
        inside = []
        for k in edge.lanes:
            lane = LaneGraphEdge(self, (self._network.lanes[k],), edge.id)
            self._lanes[k] = lane
            inside.append(lane)
        self._blocks[edge.id] = RoadBlock(edge.id, inside)

    def roadblock(self, name: str) -> RoadBlock:
        """A roadblock or roadblock connector by id."""
        return self._blocks[name] if name in self._blocks else self._joints[name]

    def of_index(self, index: int) -> LaneGraphEdge | None:
        """The lane with this index in the network, or None."""
        return self._lanes.get(index)

    def route_ids(self, edges: tuple[str, ...]) -> list[str]:
        """A route as nuPlan tells it: roadblocks, and the connectors between them where they do not touch."""
        ids = [edges[0]]
        for source, target in pairwise(edges):
            name = connector_name(source, target)
            ids += [name, target] if name in self._joints else [target]
        return ids

    def get_available_map_objects(self) -> list[SemanticMapLayer]:
        return list(SemanticMapLayer)

    def _layer(self, layer: Enum) -> dict[str, MapObject]:
        if layer.name not in self._layers:
            raise InputError(f"map layer {layer.name}: not here; there are {', '.join(self._layers)}")
        return self._layers[layer.name]

    def get_map_object(self, object_id: str, layer: Enum) -> MapObject | None:
        return self._layer(layer).get(object_id)

    def get_all_map_objects(self, point: _Place, layer: Enum) -> list[MapObject]:
        """All objects of a layer that a point is in."""
        return [one for one in self._layer(layer).values() if one.contains_point(point)]

    def get_one_map_object(self, point: _Place, layer: Enum) -> MapObject | None:
        found = self.get_all_map_objects(point, layer)
        return found[0] if found else None

    def is_in_layer(self, point: _Place, layer: Enum) -> bool:
        return bool(self.get_all_map_objects(point, layer))

    def get_proximal_map_objects(
        self, point: _Place, radius: float, layers: Iterable[Enum]
    ) -> dict[Enum, list[MapObject]]:
        """Objects by layer that are within a radius (m)."""
        here = shapely.Point(point.x, point.y)
        return {
            layer: [one for one in self._layer(layer).values() if one.polygon.distance(here) <= radius]
            for layer in layers
        }

    def get_distance_to_nearest_map_object(self, point: _Place, layer: Enum) -> tuple[str | None, float]:
        """(id, m) of the nearest object of a layer; (None, inf) where the layer is empty."""
        here = shapely.Point(point.x, point.y)
        far = [(one.polygon.distance(here), name) for name, one in self._layer(layer).items()]
        if not far:
            return None, math.inf
        distance, name = min(far)
        return name, distance


def _link(a: LaneGraphEdge, b: LaneGraphEdge) -> None:
    a.after.append(b)
    b.before.append(a)


def _blocks(lanes: Iterable[LaneGraphEdge]) -> list[RoadBlock]:
    found = {lane.get_roadblock_id(): lane for lane in lanes}
    return [lane.parent for lane in found.values()]


def _strip(crossing: Crossing) -> np.ndarray:
    left, right = (crossing.line.beside(side * crossing.width / 2) for side in (1.0, -1.0))
    return np.concatenate((left, right[::-1]))
