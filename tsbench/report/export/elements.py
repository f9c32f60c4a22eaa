"""Numbers and points as elements of CommonRoad's XML. Units: m."""

from __future__ import annotations

from typing import Any

from lxml.builder import E

from tsbench.geometry.polyline import Array

# An element; lxml's builder has no types.
Element = Any


def number(value: float) -> str:
    """A decimal as CommonRoad's schema takes it: no exponent."""
    return f"{value:.4f}"


def point(x: float, y: float) -> Element:
    return E.point(E.x(number(x)), E.y(number(y)))


def points(line: Array) -> list[Element]:
    """Elements of (n, 2) points."""
    return [point(x, y) for x, y in line.tolist()]
