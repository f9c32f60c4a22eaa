"""The words that a network's sign tokens are made of: data of its weights, kept in the head of their file.

A sign that is not among them is an unknown plate to that network, so the catalogue may grow.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.planners.weights import load_metadata
from tsbench.signs.catalog import Catalog

READER = "plant2-ft"
_KEY = "vocabulary"
# What a masked plate says (`SignView.masked`).
_POST = ""
# Rules whose plates on other arms of a junction set the right of way there.
_RIGHT_OF_WAY = ("give_way", "stop")


@dataclass(frozen=True)
class Vocabulary:
    """Codes by the row of the network's tables; a plate's value is a number beside its code, not a word.

    Attributes
    ----------
        codes: each a class of sign tokens with a projection of its own.
        full_stop: plates before which one has to have stood.
        right_of_way: plates that concern the ego on other arms of the junction ahead, too.
        ends: plates that close a zone.
    """

    codes: tuple[str, ...]
    full_stop: tuple[str, ...]
    right_of_way: tuple[str, ...]
    ends: tuple[str, ...]

    @cached_property
    def class_of(self) -> Mapping[str, int]:
        """Of codes, from 1 on: 0 is no plate."""
        return {code: k + 1 for k, code in enumerate(self.codes)}

    def with_posts(self) -> Vocabulary:
        """This, and a class for masked plates, which then leave a token of their place: for weights of a floor."""
        return replace(self, codes=(*self.codes, _POST))

    def metadata(self) -> dict[str, str]:
        """As it stands in the head of a weights file."""
        return {_KEY: json.dumps(asdict(self))}


def vocabulary_of_catalog(catalog: Catalog) -> Vocabulary:
    """All signs there are: for weights that are yet to be learned."""
    rules = {code: sign.rule.name for code, sign in catalog.signs.items()}
    return Vocabulary(
        codes=tuple(rules),
        full_stop=tuple(code for code, rule in rules.items() if rule == "stop"),
        right_of_way=tuple(code for code, rule in rules.items() if rule in _RIGHT_OF_WAY),
        ends=tuple(code for code, sign in catalog.signs.items() if sign.is_end),
    )


def vocabulary_of(folder: Path | None = None, name: str = READER) -> Vocabulary:
    """The words of a network's weights below `folder` (None: tsbench's own); InputError where they have none."""
    found = load_metadata(name, folder).get(_KEY)
    try:
        if found is None:
            raise ValueError("none in the file's head")
        raw = json.loads(found)
        fields = ("codes", "full_stop", "right_of_way", "ends")
        return Vocabulary(*(tuple(raw[field]) for field in fields))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"weights {name!r}: no vocabulary of signs ({error}): train them again (tsbench train {READER})"
        ) from None
