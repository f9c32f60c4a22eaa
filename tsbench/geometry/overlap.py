"""Where the strips swept by two paths overlap. Used when a scene is loaded, never in a tick. Units: m."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from tsbench.geometry.polyline import Array, Polyline


@dataclass(frozen=True, slots=True)
class ConflictZone:
    """Overlap of the strips of path `a` and path `b`.

    `a_in`..`a_out` and `b_in`..`b_out` are arc lengths on each path between which its strip touches the
    overlap; `polygon` is its (k, 2) outline (of the part that path `a` reaches first).
    """

    a_in: float
    a_out: float
    b_in: float
    b_out: float
    polygon: Array


def strip(line: Polyline, width: float) -> shapely.Polygon:
    """The area swept by a line of the given width, with flat ends."""
    return shapely.LineString(line.points).buffer(width / 2, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def conflict_zone(
    a: Polyline, a_width: float, b: Polyline, b_width: float, min_area: float = 0.05
) -> ConflictZone | None:
    """The conflict zone of two paths, or None where their strips do not overlap by `min_area` m2.

    Source: spec/rules.md, "Geometry". Strips that overlap in several parts give the hull of all parts
    on each path: a vehicle has cleared the zone only when it has cleared the last part.
    """
    overlap = shapely.intersection(strip(a, a_width), strip(b, b_width))
    if overlap.is_empty or overlap.area < min_area:
        return None
    parts = [p for p in shapely.get_parts(overlap) if p.geom_type == "Polygon" and p.area >= min_area / 4]
    if not parts:
        return None
    xy = np.vstack([shapely.get_coordinates(p.exterior) for p in parts])
    a_s, b_s = a.project_many(xy)[0], b.project_many(xy)[0]
    first = min(parts, key=lambda p: float(a.project_many(shapely.get_coordinates(p.exterior))[0].min()))
    return ConflictZone(
        a_in=float(np.clip(a_s.min(), 0.0, a.length)),
        a_out=float(np.clip(a_s.max(), 0.0, a.length)),
        b_in=float(np.clip(b_s.min(), 0.0, b.length)),
        b_out=float(np.clip(b_s.max(), 0.0, b.length)),
        polygon=shapely.get_coordinates(first.exterior),
    )
