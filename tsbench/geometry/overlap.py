"""Where the strips swept by two paths overlap. Used when a scene is loaded, never in a tick. Units: m."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from tsbench.geometry.polyline import Array, Polyline

# Strips that overlap by less have no conflict zone.
_LEAST_M2 = 0.05
_CELL_M = 0.5
_ACROSS = (-0.5, -0.25, 0.0, 0.25, 0.5)
_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class ConflictZone:
    """Overlap of the strips of path `a` and path `b`.

    `a_in`..`a_out` and `b_in`..`b_out` are arc lengths on each path between which its strip touches the
    overlap; `polygon` is its (k, 2) outline (of the part that path `a` reaches first). `ground`: the overlap
    cut into cells along path `b`, in its order: for each, where it ends on `b` and where it begins on `a`.
    """

    a_in: float
    a_out: float
    b_in: float
    b_out: float
    polygon: Array
    ground: tuple[tuple[float, float], ...]


def strip(line: Polyline, width: float) -> shapely.Polygon:
    """The area swept by a line of the given width, with flat ends."""
    return shapely.LineString(line.points).buffer(width / 2, cap_style="flat", join_style="mitre", mitre_limit=2.0)


def conflict_zone(
    a: Polyline, a_width: float, b: Polyline, b_width: float, min_depth: float = 0.0
) -> ConflictZone | None:
    """The conflict zone of two paths, or None where their strips do not overlap by 0.05 m2.

    Source: docs/rules.md, "Geometry". Strips that overlap in several parts give the hull of all parts
    on each path: a vehicle has cleared the zone only when it has cleared the last part. `min_depth` (m) takes
    away what is thinner: slivers between paths that lie side by side.
    """
    return conflict_zones([(a, a_width)], [(b, b_width)], min_depth)[0][0]


def conflict_zones(
    a: Sequence[tuple[Polyline, float]], b: Sequence[tuple[Polyline, float]], min_depth: float = 0.0
) -> tuple[tuple[ConflictZone | None, ...], ...]:
    """[k][j]: `conflict_zone` of path k of `a` with path j of `b`; paths are (line, width)."""
    if not a or not b:
        return tuple(() for _ in a)
    strips_a = np.array([strip(line, width) for line, width in a], dtype=object)
    strips_b = np.array([strip(line, width) for line, width in b], dtype=object)
    overlap = shapely.intersection(strips_a[:, None], strips_b[None, :])
    deep = shapely.area(overlap) >= _LEAST_M2
    if min_depth > 0.0 and deep.any():
        # Morphological opening; mitred joins give convex corners back.
        eroded = shapely.buffer(overlap[deep], -min_depth / 2, join_style="mitre")
        overlap[deep] = shapely.buffer(eroded, min_depth / 2, join_style="mitre")
        deep = shapely.area(overlap) >= _LEAST_M2
    return tuple(
        tuple(_zone(path_a, path_b, overlap[k, j]) if deep[k, j] else None for j, path_b in enumerate(b))
        for k, path_a in enumerate(a)
    )


def _zone(
    path_a: tuple[Polyline, float], path_b: tuple[Polyline, float], overlap: shapely.Geometry
) -> ConflictZone | None:
    a, b = path_a[0], path_b[0]
    parts = [p for p in shapely.get_parts(overlap) if p.geom_type == "Polygon" and p.area >= _LEAST_M2 / 4]
    if not parts:
        return None
    outlines = [shapely.get_coordinates(p.exterior) for p in parts]
    xy = np.vstack(outlines)
    a_s, b_s = a.project_many(xy)[0], b.project_many(xy)[0]
    begins = np.cumsum([0, *(len(o) for o in outlines[:-1])])
    first = int(np.argmin(np.minimum.reduceat(a_s, begins)))
    (a_in, a_out), (b_in, b_out) = (
        (min(max(float(s.min()), 0.0), line.length), min(max(float(s.max()), 0.0), line.length))
        for s, line in ((a_s, a), (b_s, b))
    )
    ground = tuple((end, min(max(begin, a_in), a_out)) for end, begin in _ground(path_a, path_b, b_in, b_out))
    return ConflictZone(a_in, a_out, b_in, b_out, outlines[first], ground)


def _ground(
    path_a: tuple[Polyline, float], path_b: tuple[Polyline, float], b_in: float, b_out: float
) -> list[tuple[float, float]]:
    """The cells of a zone: points across the middle of each on `b`; those in the strip of `a` count."""
    (a, a_width), (b, b_width) = path_a, path_b
    count = max(math.ceil((b_out - b_in) / _CELL_M), 1)
    ends = [b_in + (b_out - b_in) * (k + 1) / count for k in range(count)]
    half = (b_out - b_in) / count / 2
    points = [b.point_at(end - half, share * b_width) for end in ends for share in _ACROSS]
    s, d = (x.reshape(count, -1) for x in a.project_many(np.array(points)))
    inside = (np.abs(d) <= a_width / 2 + _TOUCH_M) & (s >= -_TOUCH_M) & (s <= a.length + _TOUCH_M)
    begins = np.where(inside, s, np.inf).min(axis=1).tolist()
    return [(end, begin) for end, begin in zip(ends, begins, strict=True) if begin < np.inf]
