"""An OSM extract in a mirror that stands on a meridian: where traffic keeps to the left it then keeps to the right.

Places change their longitude; tags that tell left from right, or count lanes from the left, tell it of the image.
Mirrored twice, an extract is what it was.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

_SWAPPED = {"left": "right", "right": "left"}
# In keys: parking:left:orientation. In values: sharp_left, no_left_turn, right_of:1, through;slight_right.
_WORD = re.compile(r"(?<![A-Za-z])(left|right)(?![A-Za-z])")
# Values of these are names, addresses or remarks, in which left and right are words.
_TEXT = re.compile(
    r"(name|note|description|fixme|addr|ref|operator|website|source|wikipedia|wikidata|destination|comment|inscription)(:|$)"
)
# One value for each lane, from left to right: turn:lanes, change:lanes:forward.
_LANES = re.compile(r"(^|:)lanes(:forward|:backward)?$")
_COUNT = re.compile(r"\d+(\.\d+)?")
# Which line of the way is drawn, counted in lanes: its image would need to know their number.
_DROPPED = re.compile(r"^placement(:|$)")


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
    if _LANES.search(key) and not _COUNT.fullmatch(value):
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
