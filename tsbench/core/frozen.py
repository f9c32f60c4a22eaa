"""Objects that are handed out many times, and that nobody may write into."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import NoReturn


class Frozen:
    """A base of classes with `__slots__`: their `__init__` fills the slots by `object.__setattr__`, once for all."""

    __slots__ = ()

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"cannot assign to {name!r} of a {type(self).__name__}")

    def __delattr__(self, name: str) -> NoReturn:
        raise FrozenInstanceError(f"cannot delete {name!r} of a {type(self).__name__}")
