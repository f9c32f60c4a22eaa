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
from tsbench.planners.base import SignView
from tsbench.planners.weights import load_metadata
from tsbench.signs.catalog import Catalog

READER = "plant2-ft"
_KEY = "vocabulary"
# What a masked plate says (`SignView.masked`).
_POST = ""


@dataclass(frozen=True)
class Vocabulary:
    """Codes by the row of the network's tables.

    Attributes
    ----------
        classes: codes of each class of sign tokens; those of one class share a projection.
        values_kmh: values of the codes that are a word of their own with each of them.
        stop, give_way: codes whose states a plate takes before and after a full stop.
        secondary: announced to another arm of the junction, they tell that arm to give way.
        ends: plates that close a zone.
    """

    classes: tuple[tuple[str, ...], ...]
    values_kmh: Mapping[str, tuple[int, ...]]
    stop: str
    give_way: str
    secondary: tuple[str, ...]
    ends: tuple[str, ...]

    @cached_property
    def words(self) -> tuple[str, ...]:
        """What a sign state may be, from 1 on: `CODE`, or `CODE@KMH`."""
        found: list[str] = []
        for code in (code for row in self.classes for code in row):
            values = self.values_kmh.get(code)
            found += [code] if values is None else [f"{code}@{value}" for value in values]
        return tuple(found)

    @cached_property
    def class_of(self) -> Mapping[str, int]:
        return {code: k + 1 for k, row in enumerate(self.classes) for code in row}

    @cached_property
    def state_of_word(self) -> Mapping[str, int]:
        return {word: k + 1 for k, word in enumerate(self.words)}

    def state_of(self, sign: SignView) -> int:
        """The state that a plate means; 0 for an unknown one. A value that is no word is read as the next lower one."""
        word = sign.code
        if sign.code in self.values_kmh:
            known, asked = self.values_kmh[sign.code], 0.0 if sign.value is None else sign.value
            word = f"{sign.code}@{max((v for v in known if v <= asked), default=min(known))}"
        return self.state_of_word.get(word, 0)

    def with_signs_of(self, catalog: Catalog) -> Vocabulary:
        """This, and behind it the catalogue's signs that it has not: for weights that are yet to be learned."""
        new = [sign for sign in catalog.signs.values() if sign.code not in self.class_of]
        printed = {s.code: tuple(map(int, s.value.allowed)) for s in new if s.value and s.value.printed}
        return Vocabulary(
            (*self.classes, *((sign.code,) for sign in new)),
            {**self.values_kmh, **printed},
            self.stop,
            self.give_way,
            self.secondary,
            (*self.ends, *(sign.code for sign in new if sign.is_end)),
        )

    def with_posts(self) -> Vocabulary:
        """This, and a class for masked plates, which then leave a token of their place: for weights of a floor."""
        return replace(self, classes=(*self.classes, (_POST,)))

    def metadata(self) -> dict[str, str]:
        """As it stands in the head of a weights file."""
        return {_KEY: json.dumps(asdict(self))}


def vocabulary_of(folder: Path | None = None, name: str = READER) -> Vocabulary:
    """The words of a network's weights below `folder` (None: tsbench's own); InputError where they have none."""
    found = load_metadata(name, folder).get(_KEY)
    try:
        if found is None:
            raise ValueError("none in the file's head")
        raw = json.loads(found)
        return Vocabulary(
            tuple(map(tuple, raw["classes"])),
            {code: tuple(values) for code, values in raw["values_kmh"].items()},
            raw["stop"],
            raw["give_way"],
            tuple(raw["secondary"]),
            tuple(raw["ends"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"weights {name!r}: no vocabulary of signs ({error}): train them again (tsbench train {READER})"
        ) from None
