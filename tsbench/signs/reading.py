"""From YAML to frozen dataclasses, each field by its type; every problem is one line: file: key: what is wrong."""

import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar, get_args, get_origin, get_type_hints

import yaml

from tsbench.core import textfile
from tsbench.core.errors import InputError

SCHEMA = 1

_TOO_BIG = 1e300  # shuts out infinity, and whole numbers that no float can hold

Shape = TypeVar("Shape")
Meaning = TypeVar("Meaning")


class _UniqueKeyLoader(yaml.CSafeLoader):
    """The safe loader, but a key that stands twice is an error and not a silent overwrite."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                continue
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"key {key!r} twice", problem_mark=key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_file(kind: type[Shape], path: Path, name: str, meaning: Callable[[Shape], Meaning]) -> Meaning:
    """What a file of the catalogue means: `meaning` of the dataclass that it holds, whose field `name` names the file.

    Raises InputError for whatever is wrong with it, ValueError of `meaning` included.
    """
    content = textfile.read_yaml(path, "sheet of the sign catalogue", _UniqueKeyLoader)
    if not isinstance(content, dict):
        raise InputError(f"{path}: the file must be a mapping of keys")
    try:
        schema = build(int, content.pop("schema", 0), "schema")
        if schema != SCHEMA:
            raise ValueError(f"schema: is {schema}, this version reads {SCHEMA}")
        file = build(kind, content)
        if (written := getattr(file, name)) != path.stem:
            raise ValueError(f"{name}: {written!r} stands in the file of {path.stem!r}")
        return meaning(file)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def build(kind: Any, value: object, where: str = "") -> Any:
    """A value of YAML as a type wants it; ValueError (`where`: what is wrong) for another.

    kind: str, float, int (at least 1), bool, a Literal of texts, a tuple, a Mapping by text, a dataclass by its
    fields (one with a default, or of no value, may be missing), and the first of a union that is as nested as the
    value.
    """
    origin, parts = get_origin(kind), get_args(kind)
    if origin is types.UnionType:
        several = [part for part in parts if get_origin(part) is tuple]
        return build(several[0] if several and isinstance(value, list) else parts[0], value, where)
    if origin is tuple:
        return _tuple(parts, value, where)
    if origin is Mapping or is_dataclass(kind):
        if not isinstance(value, dict):
            _fail(where, "must be a mapping")
        strange = next((key for key in value if not isinstance(key, str)), None)
        if strange is not None:
            _fail(_below(where, repr(strange)), "the key must be text (quote it)")
        if origin is Mapping:
            return {key: build(parts[1], entry, _below(where, key)) for key, entry in value.items()}
        return _dataclass(kind, value, where)
    return _scalar(kind, value, where)


def _tuple(parts: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        _fail(where, "must be a list")
    if parts[-1] is not ... and len(value) != len(parts):
        _fail(where, f"must be {len(parts)} entries")
    entries = tuple(build(parts[0], entry, where) for entry in value)
    if isinstance(next(iter(entries), None), str) and len(set(entries)) < len(entries):
        _fail(where, "an entry stands twice")
    return entries


def _dataclass(kind: Any, value: Mapping[str, object], where: str) -> Any:
    hints = _hints(kind)
    for key in value:
        if key not in hints:
            _fail(_below(where, key), "unknown key")
    given: dict[str, Any] = {}
    for field in fields(kind):
        if value.get(field.name) is not None:
            given[field.name] = build(hints[field.name], value[field.name], _below(where, field.name))
        elif field.default is MISSING and field.default_factory is MISSING:
            _fail(_below(where, field.name), "is missing")
    try:
        return kind(**given)
    except ValueError as error:
        raise ValueError(_below(where, str(error))) from None


def _scalar(kind: Any, value: object, where: str) -> object:
    if kind is bool:
        if not isinstance(value, bool):
            _fail(where, f"must be true or false, not {value!r}")
    elif kind is int:
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            _fail(where, f"must be a whole number of at least 1, not {value!r}")
    elif kind is float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _TOO_BIG:
            _fail(where, f"must be a number, not {value!r}")
        return float(value)
    elif not isinstance(value, str) or not value.strip():
        _fail(where, f"must be text, not {value!r} (quote codes and numbers)")
    elif get_origin(kind) is Literal and value not in get_args(kind):
        _fail(where, f"{value!r} is none of {', '.join(get_args(kind))}")
    return value


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _below(where: str, key: str) -> str:
    return f"{where}: {key}" if where else key


def _fail(where: str, problem: str) -> NoReturn:
    raise ValueError(f"{where}: {problem}")
