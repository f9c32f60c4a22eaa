"""The catalogue where traffic keeps to the left: each sign has the rule of its mirror image, with the sides swapped.

A plate that points left there means what one that points right means here: 4.1.3 permits the U-turn where traffic keeps
to the right, 4.1.2 where it keeps to the left.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import cast

from tsbench.signs.model import RuleSpec, Sign, Slot

_SIDES = {"left": "right", "right": "left", "leftmost": "rightmost", "rightmost": "leftmost"}
_TURNS = str.maketrans("lr", "rl")


def mirrored_code(signs: Mapping[str, Sign], code: str) -> str:
    """The code of a sign's mirror image."""
    return signs[code].mirrored or code


def mirrored_slot(slot: str) -> str:
    """A slot of dual paths, such as `s_l`, in the mirror; "" stays."""
    return slot.translate(_TURNS)


def mirrored_signs(signs: Mapping[str, Sign]) -> dict[str, Sign]:
    """All signs as they bind where traffic keeps to the left, in the same order."""
    return {code: _mirrored(sign, signs[mirrored_code(signs, code)], signs) for code, sign in signs.items()}


def _mirrored(sign: Sign, image: Sign, signs: Mapping[str, Sign]) -> Sign:
    """`sign` with the rule, the place and the maps of its image, mirrored; names, drawing and law stay its own."""
    place, maps = image.placement, image.maps
    return replace(
        sign,
        rule=mirrored_rule(image.rule),
        placement=replace(place, side=_SIDES.get(place.side, place.side)),  # type: ignore[arg-type]
        maps=replace(maps, slots=tuple(cast(Slot, mirrored_slot(slot)) for slot in maps.slots)),
        context=tuple(mirrored_code(signs, code) for code in image.context),
    )


def mirrored_rule(rule: RuleSpec) -> RuleSpec:
    """A rule with left and right swapped in what was chosen for it; thresholds and clauses know no side."""
    options = {name: tuple(_SIDES.get(word, word) for word in words) for name, words in rule.options.items()}
    return replace(rule, options=options)
