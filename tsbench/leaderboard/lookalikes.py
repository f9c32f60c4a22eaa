"""Names that look alike have one skeleton. Source: Unicode's table of confusable characters, UTS 39."""

from __future__ import annotations

import unicodedata
from functools import cache

from confusable_homoglyphs.confusables import confusables_data


def skeleton(name: str) -> str:
    """Equal for names that readers take for one another; for comparison only."""
    return "".join(map(_plainest, unicodedata.normalize("NFD", name)))


@cache
def _plainest(character: str) -> str:
    """What stands for all characters that look like this one."""
    alike = _alike(character)
    # A character that has many is the one that stands for them.
    if len(alike) != 1:
        return character
    (other,) = alike
    return other if len(_alike(other)) > 1 else min(character, other)


def _alike(character: str) -> list[str]:
    return [str(one["c"]) for one in confusables_data.get(character, ())]
