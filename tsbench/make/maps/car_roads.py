"""What a road for cars is: the one place that says which ways of OpenStreetMap are open to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tsbench.make.maps.plausible import some

CAR_ROADS = frozenset(
    f"{road}{link}" for road in ("motorway", "trunk", "primary", "secondary", "tertiary") for link in ("", "_link")
) | {"unclassified", "residential", "living_street", "road"}
# The most specific one that a way has decides, as for the routers OSRM and openrouteservice.
ACCESS_KEYS = ("motorcar", "motor_vehicle", "vehicle", "access")
# Values that do not let in every driver of a car.
CLOSED_VALUES = frozenset(
    (
        "no", "private", "permit", "residents", "restricted", "delivery", "forestry", "agricultural", "military",
        "emergency", "bus", "psv", "hgv",
    )
)  # fmt: skip
# A road that is no more, or not yet; `construction=minor` are works beside traffic.
_LIFECYCLE = ("abandoned", "disused", "razed", "demolished", "removed", "construction", "proposed", "planned")
_STANDS = frozenset(("no", "minor"))
_DIRECTIONS = ("forward", "backward")


def closed_by(tags: Mapping[str, str]) -> str | None:
    """The tag that closes a way to cars, as `key=value`; None for an open road and for what is no road for cars.

    A way that is closed in one direction only, or under a condition only, is open.
    """
    if tags.get("highway") not in CAR_ROADS:
        return None
    if tags.get("area") == "yes":
        return "area=yes"
    gone = next((key for key in _LIFECYCLE if tags.get(key, "no") not in _STANDS), None)
    if gone is not None:
        return f"{gone}={tags[gone]}"
    key = _deciding(tags)
    if key is None or not _closes(tags[key]):
        return None
    as_specific = ACCESS_KEYS[: ACCESS_KEYS.index(key) + 1]
    one_way = (f"{specific}:{direction}" for specific in as_specific for direction in _DIRECTIONS)
    if any(other in tags and not _closes(tags[other]) for other in one_way):
        return None
    return f"{key}={tags[key]}"


def for_cars(tags: Mapping[str, str]) -> Mapping[str, str]:
    """The tags of an open road as they hold for cars: netconvert reads `access` and `oneway` alone.

    An `access` that a more specific tag opens again is left out; the most specific `oneway` counts.
    """
    key = _deciding(tags)
    if key not in (None, "access") and not _closes(tags[key]) and _closes(tags.get("access", "yes")):
        tags = {other: value for other, value in tags.items() if other != "access"}
    one_way = next((tags[f"oneway:{whose}"] for whose in ACCESS_KEYS if f"oneway:{whose}" in tags), None)
    return tags if one_way is None else {**tags, "oneway": one_way}


def _deciding(tags: Mapping[str, str]) -> str | None:
    return next((key for key in ACCESS_KEYS if key in tags), None)


def _closes(value: str) -> bool:
    """Several values close only together: `agricultural;forestry`."""
    return all(part.strip() in CLOSED_VALUES for part in value.split(";"))


@dataclass
class ClosedRoads:
    """Ways with a road's class that are closed to cars, by the tag that closes them."""

    found: dict[str, list[int]] = field(default_factory=dict)

    def add(self, way: int, tag: str) -> None:
        self.found.setdefault(tag, []).append(way)

    @property
    def count(self) -> int:
        return sum(map(len, self.found.values()))

    @property
    def reasons(self) -> str:
        """Each tag and how many ways it closes, the most first."""
        ordered = sorted(self.found.items(), key=lambda one: (-len(one[1]), one[0]))
        return ", ".join(f"{tag:.40} {len(ways):,}" for tag, ways in ordered)

    def lines(self) -> list[str]:
        """One line for all of them; none where there are none."""
        if not self.found:
            return []
        ways = sorted(way for those in self.found.values() for way in those)
        return [
            f"ways left out, closed to cars: {self.count:,} ({self.reasons}): {some([f'way {way}' for way in ways])}"
        ]
