"""Angles in radians, counter-clockwise from +x."""

from __future__ import annotations

import math

TAU = 2.0 * math.pi


def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + math.pi) % TAU - math.pi
