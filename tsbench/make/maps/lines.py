"""Polylines as (n, 2) arrays in metres: cutting, headings, turns. Degrees, counter-clockwise from east."""

from __future__ import annotations

import numpy as np

from tsbench.geometry.angles import wrap_deg
from tsbench.make.maps.utm import Floats

HEADING_SPAN_M = 15.0


def stations(line: Floats) -> Floats:
    """Arc length at each vertex, (n,)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])


def length(line: Floats) -> float:
    return float(stations(line)[-1])


def point_at(line: Floats, at: float) -> Floats:
    """The point `at` metres along, (2,); clamped to the ends."""
    along = stations(line)
    return np.array([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def cut(line: Floats, start: float, end: float) -> Floats:
    along = stations(line)
    inner = line[(along > start + 0.05) & (along < end - 0.05)]
    return np.vstack([point_at(line, start), inner, point_at(line, end)])


def densified(line: Floats, step: float) -> Floats:
    """Points every `step` metres at most, both ends included, (k, 2)."""
    along = stations(line)
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / step)) + 1))
    return np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def heading_away(line: Floats, span: float = HEADING_SPAN_M) -> float:
    """Direction in which a line leaves its first point, over its first `span` metres."""
    dx, dy = point_at(line, span) - line[0]
    return float(np.degrees(np.arctan2(dy, dx)))


def heading_towards(line: Floats, span: float = HEADING_SPAN_M) -> float:
    """Direction in which a line arrives at its last point, over its last `span` metres."""
    return wrap_deg(heading_away(line[::-1], span) + 180.0)


def chord_over_arc(line: Floats) -> float:
    """1 for a straight line, less for a bend; 0 for a closed one."""
    arc = length(line)
    return float(np.hypot(*(line[-1] - line[0])) / arc) if arc > 0 else 0.0
