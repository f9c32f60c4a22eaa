"""Read-only objects that are handed out many times."""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from dataclasses import FrozenInstanceError
from types import MappingProxyType
from typing import Any, NoReturn, Self

import numpy as np


class Frozen:
    """A base of classes with `__slots__`: their `__init__` fills the slots by `object.__setattr__`, once for all."""

    __slots__ = ()

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"cannot assign to {name!r} of a {type(self).__name__}")

    def __delattr__(self, name: str) -> NoReturn:
        raise FrozenInstanceError(f"cannot delete {name!r} of a {type(self).__name__}")

    def __copy__(self) -> Self:
        """Itself: a copy would be no different."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Itself, as `__copy__`."""
        return self

    def __setstate__(self, state: tuple[None, dict[str, Any]]) -> None:
        """Fill the slots again, as pickle reads them; arrays come writable out of a pickle, and are not left so."""
        for name, value in state[1].items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)


def _proxy(content: dict[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(content)


def _reduced(proxy: MappingProxyType[Any, Any]) -> tuple[Any, ...]:
    return _proxy, (dict(proxy),)


# Python has no way to copy or pickle one; maps and the catalogue consist of them.
copyreg.pickle(MappingProxyType, _reduced)
