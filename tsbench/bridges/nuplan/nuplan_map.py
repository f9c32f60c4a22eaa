"""nuPlan's map API over the map that every planner is given. Units: m, m/s, rad.

A roadblock is an edge, a lane connector the path of a connection through a junction; a roadblock connector holds all
connectors from one edge to another and is called "SOURCE>TARGET". Layers are known by their names (`layer.name`), so
any enum with these names will do. Names follow nuplan-devkit 1.2 (`nuplan.common.maps`), where `nuplan_planner.kit`
registers these classes as subclasses of the abstract ones; those of classes, too, because some planners ask for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import Enum
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from tsbench.bridges.nuplan import states
from tsbench.core.errors import InputError
from tsbench.geometry.elementary import wrap
from tsbench.geometry.polyline import Array, Polyline, join
from tsbench.planners.geometry import lane_polygon
from tsbench.roads.road_map import Crossing, MapEdge, MapLane, RoadMap

_STEP_M, _CHORD_M = 0.5, 1.0
_STRAIGHT_RAD, _UTURN_RAD = math.radians(30.0), math.radians(150.0)


# A point, a pose, or whatever else has x and y.
_Place = Any


class NuPlanPolylineMapObject:
    """A lane's middle line or boundary. line: tsbench's own, of corners only. kit: makes its poses."""

    def __init__(self, name: str, line: Polyline, kit: Any) -> None:
        self.id, self.line, self._kit = name, line, kit

    @property
    def length(self) -> float:
        return self.line.length

    @cached_property
    def linestring(self) -> shapely.LineString:
        return shapely.LineString(self.line.points)

    @cached_property
    def discrete_path(self) -> list[Any]:
        """A pose every 0.5 m at most, and one at the end."""
        fine = self.line.resampled(_STEP_M)
        return [
            self._kit.StateSE2(x, y, fine.heading_at(s))
            for (x, y), s in zip(fine.points.tolist(), fine.s.tolist(), strict=True)
        ]

    def get_nearest_arc_length_from_position(self, point: _Place) -> float:
        s, _ = self.line.project(point.x, point.y)
        return min(max(s, 0.0), self.length)

    def get_nearest_pose_from_position(self, point: _Place) -> Any:
        s = self.get_nearest_arc_length_from_position(point)
        return self._kit.StateSE2(*self.line.point_at(s), self.line.heading_at(s))

    def get_curvature_at_arc_length(self, arc_length: float) -> float:
        """1/m over 2 m, positive to the left."""
        before, after = (self.line.heading_at(arc_length + side * _CHORD_M) for side in (-1.0, 1.0))
        return wrap(after - before) / (2.0 * _CHORD_M)

    def get_nearest_curvature_from_position(self, point: _Place) -> float:
        return self.get_curvature_at_arc_length(self.get_nearest_arc_length_from_position(point))


class NuPlanArea:
    """Something with an id and an area: of itself, a place where people cross."""

    def __init__(self, name: str, points: Array) -> None:
        self.id, self._points = name, points

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.Polygon(self._points).buffer(0)

    def contains_point(self, point: _Place) -> bool:
        return bool(shapely.intersects_xy(self.polygon, point.x, point.y))


class LaneGraphEdge(NuPlanArea):
    """A lane or a lane connector. lanes: those of the network that it goes along."""

    def __init__(self, roads: NuPlanMap, lanes: tuple[MapLane, ...], roadblock: str) -> None:
        self._roads, self._roadblock = roads, roadblock
        self.lanes = lanes
        self.id = ">".join(lane.id for lane in lanes)
        self.speed_limit_mps = min(lane.speed for lane in lanes)
        self.width = min(lane.width for lane in lanes)
        self.incoming_edges: list[LaneGraphEdge] = []
        self.outgoing_edges: list[LaneGraphEdge] = []
        self.stop_lines: list[Any] = []

    @cached_property
    def baseline_path(self) -> NuPlanPolylineMapObject:
        lines = [lane.line for lane in self.lanes]
        return self._line(self.id, lines[0] if len(lines) == 1 else join(lines))

    @cached_property
    def left_boundary(self) -> NuPlanPolylineMapObject:
        left, _ = self.adjacent_edges
        name = f"{left.id if left else ''}|{self.id}"
        return self._line(name, Polyline(self.baseline_path.line.beside(self.width / 2)))

    @cached_property
    def right_boundary(self) -> NuPlanPolylineMapObject:
        _, right = self.adjacent_edges
        name = f"{self.id}|{right.id if right else ''}"
        return self._line(name, Polyline(self.baseline_path.line.beside(-self.width / 2)))

    def _line(self, name: str, line: Polyline) -> NuPlanPolylineMapObject:
        return NuPlanPolylineMapObject(name, line, self._roads.kit)

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.union_all([shapely.Polygon(lane_polygon(lane)).buffer(0) for lane in self.lanes])

    @property
    def parent(self) -> NuPlanRoadBlock:
        found: NuPlanRoadBlock = self._roads.roadblock(self._roadblock)
        return found

    @property
    def parallel_edges(self) -> list[LaneGraphEdge]:
        return self.parent.interior_edges

    @property
    def adjacent_edges(self) -> tuple[LaneGraphEdge | None, LaneGraphEdge | None]:
        """(left, right): the lanes beside it that go the same way; a connector has none."""
        return self._roads.of_index(self.lanes[0].left), self._roads.of_index(self.lanes[0].right)

    def get_roadblock_id(self) -> str:
        return self._roadblock

    def has_traffic_lights(self) -> bool:
        """There are none: scenes have no signals."""
        return False

    def is_same_roadblock(self, other: LaneGraphEdge) -> bool:
        return self._roadblock == other.get_roadblock_id()

    def is_adjacent_to(self, other: LaneGraphEdge) -> bool:
        return other in self.adjacent_edges

    def is_left_of(self, other: LaneGraphEdge) -> bool:
        """Of lanes of one roadblock."""
        return self.oriented_distance(other.baseline_path.discrete_path[0]) < 0.0

    def is_right_of(self, other: LaneGraphEdge) -> bool:
        return other.is_left_of(self)

    def oriented_distance(self, point: _Place) -> float:
        """From the middle line, positive to the left."""
        line = self.baseline_path.line
        s, d = line.project(point.x, point.y)
        return math.copysign(math.hypot(d, max(-s, s - line.length, 0.0)), d)

    def get_width_left_right(self, point: _Place, include_outside: bool = False) -> tuple[float, float]:
        """From a point to the left and the right side; inf for a point that is not beside the middle line."""
        line = self.baseline_path.line
        s, d = line.project(point.x, point.y)
        if not include_outside and not (0.0 <= s <= line.length and abs(d) <= self.width / 2):
            return math.inf, math.inf
        return self.width / 2 - d, self.width / 2 + d


class NuPlanLane(LaneGraphEdge):
    """index: its place from the left, 1 first."""

    @property
    def index(self) -> int:
        left, _ = self.adjacent_edges
        return left.index + 1 if isinstance(left, NuPlanLane) else 1


class NuPlanLaneConnector(LaneGraphEdge):
    @property
    def turn_type(self) -> Any:
        path = self.baseline_path.discrete_path
        turned = wrap(path[-1].heading - path[0].heading)
        if abs(turned) < _STRAIGHT_RAD:
            return self._roads.kit.LaneConnectorType.STRAIGHT
        if abs(turned) > _UTURN_RAD:
            return self._roads.kit.LaneConnectorType.UTURN
        return self._roads.kit.LaneConnectorType["LEFT" if turned > 0.0 else "RIGHT"]


class NuPlanRoadBlock(NuPlanArea):
    """An edge. interior_edges: its lanes, from the kerb on. junction: that it leads through, for a connector."""

    def __init__(self, roads: NuPlanMap, name: str, junction: str = "") -> None:
        self._roads, self.id, self._junction = roads, name, junction
        self.interior_edges: list[LaneGraphEdge] = []
        self.children_stop_lines: list[Any] = []

    @cached_property
    def polygon(self) -> shapely.Polygon:
        return shapely.union_all([lane.polygon for lane in self.interior_edges])

    @property
    def incoming_edges(self) -> list[NuPlanRoadBlock]:
        return _blocks(lane for inner in self.interior_edges for lane in inner.incoming_edges)

    @property
    def outgoing_edges(self) -> list[NuPlanRoadBlock]:
        return _blocks(lane for inner in self.interior_edges for lane in inner.outgoing_edges)

    @property
    def parallel_edges(self) -> list[NuPlanRoadBlock]:
        return [self]

    def intersection(self) -> NuPlanIntersection | None:
        found = self._roads.layers["INTERSECTION"].get(self._junction)
        return found if isinstance(found, NuPlanIntersection) else None


class NuPlanRoadBlockConnector(NuPlanRoadBlock):
    """All connectors from one edge to another."""


class NuPlanIntersection(NuPlanArea):
    """A junction. interior_edges: its roadblock connectors; incoming_edges: lanes that lead to it."""

    def __init__(self, name: str, points: Array, intersection_type: Any) -> None:
        super().__init__(name, points)
        self.intersection_type = intersection_type
        self.interior_edges: list[NuPlanRoadBlock] = []
        self.incoming_edges: list[LaneGraphEdge] = []
        self.is_signaled = False


def connector_name(source: str, target: str) -> str:
    """The id of the roadblock connector from one edge to another."""
    return f"{source}>{target}"


class NuPlanMap:
    """`AbstractMap` of one scene. Objects are made once; what asks for areas pays for them when it asks."""

    def __init__(self, network: RoadMap, kit: Any = states) -> None:
        self.map_name, self.kit = "tsbench", kit
        self._network = network
        self._lanes: dict[int, NuPlanLane] = {}
        self._trees: dict[str, tuple[list[Any], shapely.STRtree]] = {}
        blocks: dict[str, Any] = {}
        joints: dict[str, Any] = {}
        connectors: dict[str, Any] = {}
        crossroads = {
            j.id: NuPlanIntersection(j.id, j.polygon, kit.IntersectionType.DEFAULT)
            for j in network.junctions.values()
            if len(j.polygon) > 2
        }
        for edge in network.edges.values():
            if not edge.internal:
                blocks[edge.id] = self._block(edge)
                if edge.target in crossroads:
                    crossroads[edge.target].incoming_edges += blocks[edge.id].interior_edges
        for connection in network.connections:
            a, b = self._lanes.get(connection.from_lane), self._lanes.get(connection.to_lane)
            if a is None or b is None:
                continue
            if not connection.via:
                _link(a, b)
                continue
            source, target = a.get_roadblock_id(), b.get_roadblock_id()
            name, junction = connector_name(source, target), network.edges[source].target
            through = NuPlanLaneConnector(self, tuple(network.lanes[k] for k in connection.via), name)
            _link(a, through)
            _link(through, b)
            connectors[through.id] = through
            if name not in joints:
                joints[name] = NuPlanRoadBlockConnector(self, name, junction)
                if junction in crossroads:
                    crossroads[junction].interior_edges.append(joints[name])
            joints[name].interior_edges.append(through)
        self.layers: dict[str, dict[str, Any]] = {layer.name: {} for layer in states.SemanticMapLayer}
        self.layers |= {
            "LANE": {lane.id: lane for lane in self._lanes.values()},
            "LANE_CONNECTOR": connectors,
            "ROADBLOCK": blocks,
            "ROADBLOCK_CONNECTOR": joints,
            "DRIVABLE_AREA": blocks | joints,
            "INTERSECTION": dict(crossroads),
            "CROSSWALK": {c.id: NuPlanArea(c.id, _strip(c)) for c in network.crossings.values()},
        }

    def _block(self, edge: MapEdge) -> NuPlanRoadBlock:
        block = NuPlanRoadBlock(self, edge.id)
        for k in edge.lanes:
            self._lanes[k] = NuPlanLane(self, (self._network.lanes[k],), edge.id)
            block.interior_edges.append(self._lanes[k])
        return block

    def roadblock(self, name: str) -> Any:
        """A roadblock or roadblock connector by id; None where there is none."""
        return self.layers["DRIVABLE_AREA"].get(name)

    # tuPlan Garage's planners ask nuPlan's own map for these.
    _get_roadblock = _get_roadblock_connector = roadblock

    def of_index(self, index: int) -> NuPlanLane | None:
        """The lane with this index in the network, or None."""
        return self._lanes.get(index)

    def route_ids(self, edges: tuple[str, ...]) -> list[str]:
        """A route as nuPlan tells it: roadblocks, and the connectors between them where they do not touch."""
        ids = [edges[0]]
        for source, target in pairwise(edges):
            name = connector_name(source, target)
            ids += [name, target] if self.roadblock(name) else [target]
        return ids

    def initialize_all_layers(self) -> None:
        """They are."""

    def get_available_map_objects(self) -> list[Any]:
        return list(self.kit.SemanticMapLayer)

    def get_available_raster_layers(self) -> list[Any]:
        return []

    def get_raster_map_layer(self, layer: Enum) -> Any:
        raise InputError(f"map layer {layer.name}: there are no raster maps here; ask for its objects")

    def get_raster_map(self, layers: Sequence[Enum]) -> Any:
        return [self.get_raster_map_layer(layer) for layer in layers]

    def _layer(self, layer: Enum) -> dict[str, Any]:
        if layer.name not in self.layers:
            raise InputError(f"map layer {layer.name}: not here; there are {', '.join(self.layers)}")
        return self.layers[layer.name]

    def _tree(self, layer: Enum) -> tuple[list[Any], shapely.STRtree]:
        if layer.name not in self._trees:
            found = list(self._layer(layer).values())
            self._trees[layer.name] = found, shapely.STRtree([one.polygon for one in found])
        return self._trees[layer.name]

    def _within(self, point: _Place, radius: float, layer: Enum) -> list[Any]:
        found, tree = self._tree(layer)
        near = tree.query(shapely.Point(point.x, point.y), predicate="dwithin", distance=radius)
        return [found[k] for k in sorted(near.tolist())]

    def get_map_object(self, object_id: str, layer: Enum) -> Any:
        return self._layer(layer).get(object_id)

    def get_all_map_objects(self, point: _Place, layer: Enum) -> list[Any]:
        """All objects of a layer that a point is in."""
        return self._within(point, 0.0, layer)

    def get_one_map_object(self, point: _Place, layer: Enum) -> Any:
        return next(iter(self.get_all_map_objects(point, layer)), None)

    def is_in_layer(self, point: _Place, layer: Enum) -> bool:
        return bool(self.get_all_map_objects(point, layer))

    def get_proximal_map_objects(self, point: _Place, radius: float, layers: Iterable[Enum]) -> dict[Enum, list[Any]]:
        """Objects by layer that are within a radius (m)."""
        return {layer: self._within(point, radius, layer) for layer in layers}

    def get_distance_to_nearest_map_object(self, point: _Place, layer: Enum) -> tuple[str | None, float]:
        """(id, m) of the nearest object of a layer; (None, inf) where the layer is empty."""
        found, tree = self._tree(layer)
        if not found:
            return None, math.inf
        near, far = tree.query_nearest(shapely.Point(point.x, point.y), return_distance=True)
        return found[int(near.min())].id, float(far[0])

    def get_distance_to_nearest_raster_layer(self, point: _Place, layer: Enum) -> float:
        return self.get_distance_to_nearest_map_object(point, layer)[1]

    def get_distances_matrix_to_nearest_map_object(self, points: Sequence[_Place], layer: Enum) -> Array:
        """(n,) m of each point."""
        return np.array([self.get_distance_to_nearest_map_object(point, layer)[1] for point in points])


def _link(a: LaneGraphEdge, b: LaneGraphEdge) -> None:
    a.outgoing_edges.append(b)
    b.incoming_edges.append(a)


def _blocks(lanes: Iterable[LaneGraphEdge]) -> list[NuPlanRoadBlock]:
    found = {lane.get_roadblock_id(): lane for lane in lanes}
    return [lane.parent for lane in found.values()]


def _strip(crossing: Crossing) -> Array:
    left, right = (crossing.line.beside(side * crossing.width / 2) for side in (1.0, -1.0))
    return np.concatenate((left, right[::-1]))
