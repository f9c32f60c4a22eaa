"""Text, JSON and YAML files from users, and dataclasses from the plain values in them; an error is one clear line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, is_dataclass
from dataclasses import fields as dataclass_fields
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

from tsbench.core.errors import InputError
from tsbench.core.text import fault_in_texts

# Far more than any of ours has.
_MOST_BYTES = 1 << 26
_DEEPEST = 50


def read_text(path: Path, what: str) -> str:
    """A file of UTF-8 text. Raises InputError; `what` says what it should be."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise InputError(f"{path}: larger than {_MOST_BYTES >> 20} MiB: cannot be a {what}")
        return content.decode()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: no {what}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read as a {what} (byte {error.start} is not UTF-8)") from None


def read_json(path: Path, what: str) -> Any:
    """The content of a JSON file. Raises InputError; `what` says what it should be."""
    try:
        content = json.loads(read_text(path, what))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None
    if fault := _fault_in_depth(content) or fault_in_texts(content):
        raise InputError(f"{path}: cannot be read as a {what} ({fault})")
    return content


def _fault_in_depth(content: Any) -> str:
    level = [content]
    for _ in range(_DEEPEST):
        level = [
            inner
            for one in level
            if isinstance(one, dict | list)
            for inner in (one.values() if isinstance(one, dict) else one)
        ]
        if not level:
            return ""
    return f"more than {_DEEPEST} levels deep"


def read_yaml(path: Path, what: str, loader: type[yaml.CSafeLoader] = yaml.CSafeLoader) -> Any:
    """The content of a YAML file. Raises InputError; `what` says what it should be."""
    text = read_text(path, what)
    try:
        _check_depth(path, text)
        return loader(text).get_single_data()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or " ".join(str(error).split())
        raise InputError(f"{path}: {line}{problem or 'not YAML'}") from None
    except (ValueError, TypeError) as error:
        # An impossible date, a number without an end, a mapping as a key.
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None


def _check_depth(path: Path, text: str) -> None:
    """The reader goes down with the content, and ends the process where that is too deep."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > _DEEPEST:
            raise InputError(f"{path}: more than {_DEEPEST} levels deep")


T = TypeVar("T")

# JSON has no such numbers, so some files hold them as text.
_NOT_FINITE = ("nan", "inf", "-inf")
_LARGEST_INT = 1 << 63


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
    if abs(number) >= _LARGEST_INT:
        raise ValueError("a whole number below 2^63 was expected")
    return number


@cache
def _fields(kind: Any) -> Mapping[str, Any]:
    return get_type_hints(kind)
