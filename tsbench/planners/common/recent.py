"""What was made of the last few things, for things that come back soon: networks, paths."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")

_MOST = 4


class Recent(Generic[K, V]):
    """Makes a value of a thing when it is first asked for, and keeps those of the last four. Things go by identity."""

    def __init__(self, make: Callable[[K], V]) -> None:
        self._make = make
        self._kept: list[tuple[K, V]] = []

    def __call__(self, thing: K) -> V:
        for known, value in self._kept:
            if known is thing:
                return value
        value = self._make(thing)
        self._kept = [(thing, value), *self._kept[: _MOST - 1]]
        return value
