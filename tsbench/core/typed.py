"""Plain values of files and messages as dataclasses, each field by its type; a fault is `key: key: what is wrong`."""

import re
import types
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Required, TypeVar, Union, get_args, get_origin, get_type_hints, is_typeddict

import msgspec
from msgspec import Meta

from tsbench.core.errors import InputError
from tsbench.core.textfile import read_json, read_yaml

SCHEMA = 1

# No `pattern` anywhere: with one in use, Python breaks down at its end now and then (msgspec 0.22, its issue 717).
Text = Annotated[str, Meta(min_length=1)]
Number = Annotated[float, Meta(gt=-1e300, lt=1e300)]
Count = Annotated[int, Meta(ge=1)]

# Python's whole numbers have no end; those of tables and other programs have.
_LARGEST_INT = 1 << 63
_WORDS = {
    "object": "a mapping",
    "array": "a list",
    "str": "text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "null": "nothing",
}
_STEP = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")
_MISSING = re.compile(r"Object missing required field `(\w+)`")

T = TypeVar("T")
Meaning = TypeVar("Meaning")


def typed(kind: type[T], value: object, *, strict: bool = True, more: bool = False) -> T:
    """A value of a type: a dataclass with its fields and no others (those with a default may be missing), or what such
    fields may be. Raises ValueError for others.

    strict: else texts may stand for numbers: JSON has none for NaN and the infinities. more: there may be other fields.
    """
    try:
        made = msgspec.convert(value, kind, strict=strict)
    except msgspec.ValidationError as problem:
        raise ValueError(_fault(kind, value, str(problem))) from None
    if fault := not more and next(_strange(value, made), ""):
        raise ValueError(fault)
    return made


def read_typed(kind: type[T], path: Path, what: str) -> T:
    """What a JSON or YAML file holds. Raises InputError; `what` says what it should be."""
    content = (read_json if path.suffix == ".json" else read_yaml)(path, what)
    try:
        return typed(kind, content)
    except ValueError as problem:
        raise InputError(f"{path}: {problem}") from None


def read_sheet(kind: type[T], path: Path, name: str, meaning: Callable[[T], Meaning]) -> Meaning:
    """What a YAML file means: `meaning` of the dataclass that it holds, whose field `name` names the file.

    Raises InputError for whatever is wrong with it, ValueError of `meaning` included.
    """
    content = read_yaml(path, f"sheet of the {name} {path.stem!r}")
    try:
        schema = content.pop("schema", "missing") if isinstance(content, dict) else SCHEMA
        if schema is True or schema != SCHEMA:
            raise ValueError(f"schema: is {schema!r:.80}, this version reads {SCHEMA}")
        sheet = typed(kind, content)
        if fault := next(_odd(content), ""):
            raise ValueError(fault)
        if (written := getattr(sheet, name)) != path.stem:
            raise ValueError(f"{name}: {written!r} stands in the file of {path.stem!r}")
        return meaning(sheet)
    except ValueError as problem:
        raise InputError(f"{path}: {problem}") from None


def _strange(given: Any, made: Any) -> Iterator[str]:
    """What a value has that its type has not."""
    if isinstance(given, Mapping):
        known = made if isinstance(made, Mapping) else {f.name: getattr(made, f.name) for f in fields(made)}
        for key, inner in given.items():
            if key not in known:
                yield f"{key}: unknown key" + f"; there are {', '.join(known)}" * is_dataclass(made)
            else:
                yield from (f"{key}: {fault}" for fault in _strange(inner, known[key]))
    elif isinstance(given, list | tuple):
        for k, (inner, entry) in enumerate(zip(given, made, strict=False), 1):
            yield from (f"number {k}: {fault}" for fault in _strange(inner, entry))
    elif isinstance(given, int) and abs(given) >= _LARGEST_INT:
        yield f"must be a whole number below 2^63, not {given!r:.80}"


def _odd(given: Any) -> Iterator[str]:
    """Texts of blanks alone, and those that a list has twice."""
    if isinstance(given, str) and given.isspace():
        yield f"must be text, not {given!r:.80}"
    if isinstance(given, list):
        counts = Counter(text for text in given if isinstance(text, str))
        yield from (f"{text!r:.80} stands twice" for text, count in counts.items() if count > 1)
    for key, inner in given.items() if isinstance(given, dict) else enumerate(given) if isinstance(given, list) else ():
        yield from (f"{key}: {fault}" for fault in _odd(inner))


def _fault(kind: Any, value: Any, told: str) -> str:
    """An error of msgspec, which names no keys of mappings and not the words that are allowed."""
    what, _, at = told.rpartition(" - at `") if " - at `" in told else (told, "", "")
    where = []
    for field, entry in _STEP.findall(at):
        kind = _part(kind, field)
        step = field or int(entry) if entry != "..." else next(k for k, v in value.items() if _fails(kind, v))
        value = value[step]
        where.append(f"number {step + 1}" if isinstance(step, int) and entry != "..." else str(step))
    if at.startswith("key`"):
        kind = next((get_args(arm)[0] for arm in _arms(kind) if get_args(arm)), str)
        value = next(key for key in value if _fails(kind, key))
        where.append(f"key {value!r:.80}")
    if missing := _MISSING.match(what):
        where.append(missing[1])
        what = "is missing"
    elif allowed := [word for arm in _arms(kind) if get_origin(arm) is Literal for word in get_args(arm)]:
        what = f"{value!r:.80} is none of {', '.join(map(str, allowed))}"
    elif what.startswith("Expected "):
        wanted = re.sub(
            "`(.*?)`",
            lambda found: " or ".join(_WORDS.get(one, one) for one in found[1].split(" | ")),
            what.removeprefix("Expected ").partition(", got ")[0],
        )
        quote = " (quote codes and numbers)" * ("text" in wanted and not isinstance(value, str))
        what = f"must be {wanted}, not {value!r:.80}{quote}"
    return ": ".join([*where, what])


def _fails(kind: Any, value: object) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return True
    return False


def _part(kind: Any, field: str) -> Any:
    """The type of a field of a dataclass, or of the entries of a mapping or a list."""
    for arm in _arms(kind):
        if field and (is_dataclass(arm) or is_typeddict(arm)):
            return get_type_hints(arm, include_extras=True)[field]
        if not field and get_origin(arm) not in (None, Literal):
            parts = [part for part in get_args(arm) if part is not ...]
            return parts[-1]
    return Any


def _arms(kind: Any) -> tuple[Any, ...]:
    """The types that a type is one of."""
    if get_origin(kind) in (Annotated, Required):
        return _arms(get_args(kind)[0])
    return get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
