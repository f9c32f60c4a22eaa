"""Options as fields of a dataclass, and checks of what is given from Python, in a script's words.

A field that `option` declares is an option of the command line (`cli.options.of`), a keyword in Python
(`from_python`), and a key of tsbench.toml and of campaigns.
"""

from __future__ import annotations

import math
import operator
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from tsbench.core.errors import InputError
from tsbench.core.paths import expanded, expanded_text

TOML = Path("tsbench.toml")
Kind = Literal["planners", "split", "city", "types", "count", "number", "choice", "flag", "text", "folder", "listeners"]


@dataclass(frozen=True, slots=True)
class Option:
    """What is known of an option beside its name and default.

    help: a sentence for `--help`.
    kind: how it is given and read.
    choices: the values that there are, () = any.
    least: of a number.
    metavar: what stands for the value in `--help`.
    shown: what stands for a default of None there.
    asked: does it stand in `run.json` as it was given?
    decides: does it decide what is in the folder, so that a run with another value is another run?
    """

    help: str
    kind: Kind
    choices: tuple[str, ...] = ()
    least: int = 1
    metavar: str | None = None
    shown: str | None = None
    asked: bool = True
    decides: bool = False


def option(kind: Kind, help: str, default: Any = MISSING, **known: Any) -> Any:
    """A field of a dataclass that is an option. known: as in `Option`."""
    return field(default=default, metadata={"option": Option(help, kind, **known)})


def options_in(owner: Any) -> dict[str, Option]:
    """The options among the fields of a dataclass, by name."""
    return {f.name: f.metadata["option"] for f in fields(owner) if "option" in f.metadata}


def from_python(owner: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of options by name, as a dataclass takes them. Raises InputError for a value of another kind."""
    known = options_in(owner)
    may_lack = {f.name for f in fields(owner) if f.default is None or f.default is MISSING} | {"city"}
    return {
        name: None if value is None and name in may_lack else _value(name, known[name], value)
        for name, value in given.items()
    }


def _value(name: str, known: Option, value: Any) -> Any:
    match known.kind:
        case "types":
            return type_words(name, value)
        case "count":
            return whole_number(name, value)
        case "number":
            return number_of(name, value, known.least)
        case "flag":
            return switch(name, value)
        case "folder":
            return path_of(name, value)
        case "text" if isinstance(value, Path):
            return expanded_text(str(value))
        case "text" | "city":
            return expanded_text(text(name, value))
        case _:
            if known.choices and value not in known.choices:
                raise InputError(f"{name} {value}: expected {', '.join(known.choices)}")
            return value


def toml_section(path: Path, name: str) -> Any:
    """A section of a TOML file, {} where it is missing. Raises InputError for what is no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8")).get(name, {})
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not TOML ({error})") from None


def whole_number(name: str, value: object, unit: str = "") -> int:
    """The value as an int. Raises InputError for a fraction, a truth value, words, and what is less than 1."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None:
        raise InputError(f"{name} {value!r}: expected a whole number")
    if number < 1:
        raise InputError(f"{name} {number}: expected at least 1{unit}")
    return number


def number_of(name: str, value: object, least: float) -> float:
    """The value as a float. Raises InputError for anything but a number, and below `least`."""
    try:
        number = math.nan if isinstance(value, str | bool) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} {value!r}: expected a number")
    if number < least:
        raise InputError(f"{name} {number:g}: expected at least {least:g}")
    return number


def switch(name: str, value: object) -> bool:
    """The value, True or False. Raises InputError for anything else: "no" would count as yes."""
    if not isinstance(value, bool):
        raise InputError(f"{name} {value!r}: expected True or False")
    return value


def text(name: str, value: object) -> str:
    """The value. Raises InputError for what is no text."""
    if not isinstance(value, str):
        raise InputError(f"{name} {value!r}: expected text")
    return value


def path_of(name: str, value: object) -> Path:
    """The value as a path, `~` at its beginning as the home folder. Raises InputError for other values."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name} {value!r}: expected a path")
    if not os.fspath(value):
        raise InputError(f"{name}: is empty: name a file or a folder")
    return expanded(os.fspath(value))


def type_words(name: str, asked: str | Sequence[str] | None) -> tuple[str, ...]:
    """Types and groups, given one by one or with commas between them; none for None, which stands for the default.

    Raises InputError where no word is named: who filters a list down to nothing does not want all.
    """
    if asked is None:
        return ()
    given = asked.split(",") if isinstance(asked, str) else asked
    if not isinstance(given, list | tuple | set | frozenset) or not all(isinstance(w, str) for w in given):
        raise InputError(f"{name} {asked!r}: expected types and groups, as a text or a list of texts")
    words = tuple(word.strip() for word in given if word.strip())
    if not words:
        raise InputError(f"{name} {asked!r}: names no type; leave it out where none is to be named")
    return words
