"""Where the strips swept by two paths overlap. Used when a scene is loaded, never in a tick. Units: m."""

from __future__ import annotations

from collections.abc import Sequence
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
    return shapely.LineString(line.points).buffer(
        width / 2, cap_style="flat", join_style="mitre", mitre_limit=2.0
    )


def conflict_zone(
    a: Polyline, a_width: float, b: Polyline, b_width: float, min_area: float = 0.05, min_depth: float = 0.0
) -> ConflictZone | None:
    """The conflict zone of two paths, or None where their strips do not overlap by `min_area` m2.

    Source: docs/spec/rules.md, "Geometry". Strips that overlap in several parts give the hull of all parts
    on each path: a vehicle has cleared the zone only when it has cleared the last part. `min_depth` (m) takes
    away what is thinner: slivers between paths that lie side by side.
    """
    return conflict_zones([(a, a_width)], [(b, b_width)], min_area, min_depth)[0][0]


def conflict_zones(
    a: Sequence[tuple[Polyline, float]],
    b: Sequence[tuple[Polyline, float]],
    min_area: float = 0.05,
    min_depth: float = 0.0,
) -> tuple[tuple[ConflictZone | None, ...], ...]:
    """[k][j]: `conflict_zone` of path k of `a` with path j of `b`; paths are (line, width)."""
    if not a or not b:
        return tuple(() for _ in a)
    strips_a = np.array([strip(line, width) for line, width in a], dtype=object)
    strips_b = np.array([strip(line, width) for line, width in b], dtype=object)
    overlap = shapely.intersection(strips_a[:, None], strips_b[None, :])
    deep = shapely.area(overlap) >= min_area
    if min_depth > 0.0 and deep.any():
        # Morphological opening; mitred joins give convex corners back.
        eroded = shapely.buffer(overlap[deep], -min_depth / 2, join_style="mitre")
        overlap[deep] = shapely.buffer(eroded, min_depth / 2, join_style="mitre")
        deep = shapely.area(overlap) >= min_area
    return tuple(
        tuple(
            _zone(line_a, line_b, overlap[k, j], min_area) if deep[k, j] else None
            for j, (line_b, _) in enumerate(b)
        )
        for k, (line_a, _) in enumerate(a)
    )


def _zone(a: Polyline, b: Polyline, overlap: shapely.Geometry, min_area: float) -> ConflictZone | None:
    parts = [p for p in shapely.get_parts(overlap) if p.geom_type == "Polygon" and p.area >= min_area / 4]
    if not parts:
        return None
    outlines = [shapely.get_coordinates(p.exterior) for p in parts]
    xy = np.vstack(outlines)
    a_s, b_s = a.project_many(xy)[0], b.project_many(xy)[0]
    begins = np.cumsum([0, *(len(o) for o in outlines[:-1])])
    first = int(np.argmin(np.minimum.reduceat(a_s, begins)))
    return ConflictZone(
        a_in=min(max(float(a_s.min()), 0.0), a.length),
        a_out=min(max(float(a_s.max()), 0.0), a.length),
        b_in=min(max(float(b_s.min()), 0.0), b.length),
        b_out=min(max(float(b_s.max()), 0.0), b.length),
        polygon=outlines[first],
    )
