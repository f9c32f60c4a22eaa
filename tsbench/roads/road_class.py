"""The limit that a road has by its class alone, m/s: what a driver expects of it where no plate says otherwise.

Source: sumo_nets/netconvert/moscow.typ.xml, its column of speeds (60 km/h in town, Traffic Rules 10.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

CLASS_SPEED_MPS: Mapping[str, float] = MappingProxyType(
    {
        "highway.motorway": 27.78, "highway.motorway_link": 16.67, "highway.trunk": 22.22,
        "highway.trunk_link": 16.67, "highway.primary": 16.67, "highway.primary_link": 16.67,
        "highway.secondary": 16.67, "highway.secondary_link": 16.67, "highway.tertiary": 16.67,
        "highway.tertiary_link": 16.67, "highway.unclassified": 16.67, "highway.residential": 11.11,
        "highway.road": 11.11, "highway.living_street": 5.56, "highway.service": 5.56,
    }
)  # fmt: skip
