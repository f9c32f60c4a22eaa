"""Dataclasses from the plain values (numbers, text, lists, dictionaries) that files and lines of JSON hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, is_dataclass
from dataclasses import fields as dataclass_fields
from functools import cache
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")

# JSON has no such numbers, so some files hold them as text.
_NOT_FINITE = ("nan", "inf", "-inf")
_LARGEST = 1 << 63


def dataclass_from_json(kind: type[T], value: Any) -> T:
    """A value of a type: a dataclass with its fields (those with a default
    may be missing), or what such fields may be. ValueError for others.
    """
    made: T = _made(kind, value)
    return made


def _made(kind: Any, value: Any) -> Any:
    if isinstance(kind, type) and is_dataclass(kind):
        fields = _fields(kind)
        needed = {f.name for f in dataclass_fields(kind) if f.default is f.default_factory is MISSING}
        if not isinstance(value, Mapping) or not needed <= value.keys() <= fields.keys():
            raise ValueError(f"{kind} has the fields {sorted(fields)}, not {value!r:.80}")
        return kind(**{name: _made(fields[name], one) for name, one in value.items()})
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if NoneType in parts:
        return None if value is None else _made(parts[0], value)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"a list was expected, not {value!r:.80}")
        return tuple(_made(parts[0], one) for one in value)
    if origin is float and (type(value) is int or value in _NOT_FINITE):
        return float(value) if isinstance(value, str) else float(_bounded(value))
    # A truth value is no number, though Python takes it for one.
    if origin is not Any and not (isinstance(value, origin) and isinstance(value, bool) is (origin is bool)):
        raise ValueError(f"{origin.__name__} was expected, not {value!r:.80}")
    return _bounded(value) if origin is int else value


def _bounded(number: int) -> int:
    """Python's whole numbers have no end; those of tables and other programs have."""
    if abs(number) >= _LARGEST:
        raise ValueError("a whole number below 2^63 was expected")
    return number


@cache
def _fields(kind: Any) -> Mapping[str, Any]:
    return get_type_hints(kind)
