"""Checks of what is given from Python, which the command line's own types refuse by themselves, in a script's words."""

from __future__ import annotations

import math
import operator
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.paths import expanded

# A command stays as it is.
_OPTION = re.compile(r"tsbench [^:;,()]*|--([a-z][a-z-]*)")
# Options without a value.
_FLAGS = ("allow_partial", "force", "isolate", "mask_signs")


@contextmanager
def keywords() -> Iterator[None]:
    """Within it, or within a function that it decorates, an InputError names keywords: `force=True` for `--force`."""
    try:
        yield
    except InputError as error:
        told = _OPTION.sub(_keyword, str(error))
        if type(error) is not InputError or told == str(error):
            raise
        raise InputError(told) from error.__cause__


def _keyword(found: re.Match[str]) -> str:
    if found[1] is None:
        return found[0]
    name = found[1].replace("-", "_")
    return f"{name}=True" if name in _FLAGS else name


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
