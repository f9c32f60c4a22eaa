"""The area that may be driven on, as polygons and outlines: made once per network, for learned planners. Units: m."""

from __future__ import annotations

import numpy as np
import shapely

from tsbench.geometry.overlap import strip
from tsbench.geometry.polyline import Array
from tsbench.roads.road_map import RoadMap

# Lanes side by side leave slits of a centimetre or so: they are no edges.
_SLIT_M = 0.15
_COARSE_M = 0.15


def road_area(network: RoadMap) -> shapely.Geometry:
    """Union of all lane strips and junction areas, without the slits between them."""
    parts = [strip(lane.line, lane.width) for lane in network.lanes]
    parts += [shapely.Polygon(j.polygon) for j in network.junctions.values() if len(j.polygon) >= 3]
    wide = shapely.buffer(shapely.make_valid(np.array(parts, dtype=object)), _SLIT_M, join_style="mitre")
    return shapely.buffer(shapely.union_all(wide), -_SLIT_M, join_style="mitre")


def road_edges(network: RoadMap) -> Array:
    """(n, 4) segments x0, y0, x1, y1 of the area's outline."""
    area = shapely.simplify(road_area(network), _COARSE_M)
    chunks = []
    for part in shapely.get_parts(area):
        if part.geom_type != "Polygon":
            continue
        for ring in (part.exterior, *part.interiors):
            xy = shapely.get_coordinates(ring)
            chunks.append(np.hstack((xy[:-1], xy[1:])))
    return np.vstack(chunks) if chunks else np.empty((0, 4))
