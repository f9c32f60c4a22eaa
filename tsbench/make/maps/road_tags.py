"""Tags of roads: which of OpenStreetMap's are slips of the pen, or not used, and which ways are open to cars.

Of an extract in a mirror, the tags say right where they said left.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

# Hardly any road has a higher limit; without a limit netconvert takes 142 km/h.
FASTEST_KMH = 150.0
FASTEST_MPS = FASTEST_KMH / 3.6
# Outside these a width is no lane's: netconvert halves the lane of a two-way road tagged lanes=1.
WIDTH_RANGE_M = (2.75, 4.5)
_SPEED, _LANES, _ONE_WAY_LANES = (3.0, FASTEST_KMH, " km/h"), (1.0, 16.0, ""), (0.0, 16.0, "")
_ROAD_WIDTH, _LANE_WIDTH = (1.0, 40.0, " m"), (1.0, 10.0, " m")
# Lanes in the middle for both directions, which netconvert takes for one forward; `lanes` counts them.
BOTH_WAYS = "lanes:both_ways"
# Where these say that there is no limit, netconvert takes 142 km/h.
_NO_LIMIT, _FAST = ("none", "no", "DE:motorway"), ("motorway", "trunk")
# Tags of single lanes that nothing here reads: all lanes are open to cars, at the road's limit.
_BY_LANE = re.compile(
    r"((access|vehicle|motor_vehicle|motorcar|bus|psv|taxi|hov|hgv|bicycle|maxspeed):lanes|lanes:(bus|psv|taxi|hov))"
    r"(:forward|:backward|:both_ways)?"
)
# By tag that netconvert takes a number from: least, most, unit.
BOUNDS = {
    **dict.fromkeys(("maxspeed", "maxspeed:forward", "maxspeed:backward", "maxspeed:type", "zone:maxspeed"), _SPEED),
    "lanes": _LANES,
    **dict.fromkeys(("lanes:forward", "lanes:backward", BOTH_WAYS), _ONE_WAY_LANES),
    "width": _ROAD_WIDTH,
    **dict.fromkeys(("width:lanes", "width:lanes:forward", "width:lanes:backward"), _LANE_WIDTH),
}
# What netconvert reads as a number: 50, DE:30, DE:zone30, 30 mph, 1e4, 0x50, inf.
_NUMBER = re.compile(
    r"(?:..:(?:zone:?)?|[A-Z]{2}(?:zone)?)?"
    r"([+-]?(?:0x[0-9a-f]+|(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan))\s*([a-z/]*)",
    re.IGNORECASE,
)
# Its units, in km/h and in metres.
_UNITS = {
    **dict.fromkeys(("", "km/h", "kmh", "kph", "kmph", "m", "metre", "meter", "metres", "meters"), 1.0),
    "mph": 1.609344,
    "knots": 1.852,
    "m/s": 3.6,
    "km": 1000.0,
    "ft": 0.3048,
    "cm": 0.01,
    "in": 0.0254,
}
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
_SWAPPED = {"left": "right", "right": "left"}
# In keys: parking:left:orientation. In values: sharp_left, no_left_turn, right_of:1, through;slight_right.
_WORD = re.compile(r"(?<![A-Za-z])(left|right)(?![A-Za-z])")
# Values of these are names, addresses or remarks, in which left and right are words.
_TEXT = re.compile(
    r"(name|note|description|fixme|addr|ref|operator|website|source|wikipedia|wikidata|destination|comment|inscription)(:|$)"
)
# One value for each lane, from left to right: turn:lanes, change:lanes:forward.
_PER_LANE = re.compile(r"(^|:)lanes(:forward|:backward)?$")
_COUNT = re.compile(r"\d+(\.\d+)?")
# Which line of the way is drawn, counted in lanes: its image would need to know their number.
_DROPPED = re.compile(r"^placement(:|$)")


def is_plausible(key: str, value: str) -> bool:
    """May a road be tagged so? What is no number is not judged: netconvert does not take it, and says so."""
    if key not in BOUNDS:
        return True
    least, most, _ = BOUNDS[key]
    numbers = (_number(part) for part in re.split("[;|]", value))
    return all(number is None or least <= number <= most for number in numbers)


def _number(text: str) -> float | None:
    """In km/h, lanes or metres; None for a text without a number or with an unknown unit, infinity for "nan"."""
    found = _NUMBER.fullmatch(text.strip())
    unit = _UNITS.get(found[2].lower()) if found else None
    if found is None or unit is None:
        return None
    value = float(int(found[1], 16)) if "x" in found[1].lower() else float(found[1])
    return math.inf if math.isnan(value) else value * unit


@dataclass
class SetAside:
    """Tags of roads that are not believed, or not used: which they were, by what is said of them."""

    found: dict[str, list[str]] = field(default_factory=dict)

    def from_road(self, way: int, tags: Mapping[str, str]) -> dict[str, str]:
        """The tags of a road as it can be."""
        kept = {}
        for key, value in tags.items():
            if not is_plausible(key, value):
                least, most, unit = BOUNDS[key]
                self._add(f"the tag {key} set aside, not {least:g} to {most:g}{unit}", way, value)
            elif BOUNDS.get(key) == _SPEED and value in _NO_LIMIT and tags["highway"] not in _FAST:
                self._add(f"the tag {key} set aside, only motorways and trunks have no limit", way, value)
            elif key == BOTH_WAYS:
                self._add(f"the tag {key} set aside, lanes for both directions are not made", way, value)
            else:
                kept[key] = value
                if _BY_LANE.fullmatch(key):
                    self._add(f"the tag {key} not used, all lanes are alike", way, value)
        lanes, both = (_number(tags.get(key, "")) or 0.0 for key in ("lanes", BOTH_WAYS))
        if "lanes" in kept and 0.0 < both < lanes:
            kept["lanes"] = f"{lanes - both:g}"
        return kept

    def lines(self) -> list[str]:
        """One line for each key and reason."""
        return [f"{said}: {some(those)}" for said, those in sorted(self.found.items())]

    def _add(self, said: str, way: int, value: str) -> None:
        self.found.setdefault(said, []).append(f"{value!r:.40} of way {way}")


def some(names: list[str], shown: int = 5) -> str:
    """The first of them, and how many more."""
    more = len(names) - shown
    return ", ".join(names[:shown]) + (f" and {more:,} more" if more > 0 else "")


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


def mirrored(entity: Any, meridian: int, tags: Mapping[str, str] | None = None) -> Any:
    """A node, way or relation of pyosmium in the mirror; meridian: degrees east; tags: instead of its own."""
    tags = mirrored_tags(tags.items() if tags is not None else ((tag.k, tag.v) for tag in entity.tags))
    if entity.is_node() and entity.location.valid():
        # In whole units of 1e-7 degrees, so that nothing is lost.
        place = entity.location
        image = (2 * meridian * 10_000_000 - place.x) / 1e7
        return entity.replace(location=(_turned(image), place.lat), tags=tags)
    return entity.replace(tags=tags)


def mirrored_tags(tags: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Tags of the image."""
    return {_words(key): _value(key, value) for key, value in tags if not _DROPPED.match(key)}


def _value(key: str, value: str) -> str:
    if _PER_LANE.search(key) and not _COUNT.fullmatch(value):
        value = "|".join(reversed(value.split("|")))
        if _TEXT.match(key):
            return value
    elif _TEXT.match(key):
        return value
    return _words(value)


def _words(text: str) -> str:
    return _WORD.sub(lambda found: _SWAPPED[found[0]], text.replace("_", "\0")).replace("\0", "_")


def _turned(longitude: float) -> float:
    """Between -180 and 180 degrees."""
    return longitude - 360.0 if longitude > 180.0 else longitude + 360.0 if longitude < -180.0 else longitude
