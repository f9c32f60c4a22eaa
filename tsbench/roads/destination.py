"""Where the ego is to go."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Destination:
    """The point to reach: edge id and arc length along it (m); any lane of the edge counts."""

    edge: str
    s: float
