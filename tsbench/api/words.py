"""Errors in a script's words: what is an option of the command line is a keyword there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from tsbench.core.errors import InputError

_OPTION = re.compile(r"--([a-z][a-z-]*)")
# Options without a value.
_FLAGS = ("allow_partial", "force", "isolate", "mask_signs")


def in_words_of_python(text: str) -> str:
    """A message for a script: `force=True` for `--force`, `limit` for `--limit`."""

    def keyword(found: re.Match[str]) -> str:
        name = found[1].replace("-", "_")
        return f"{name}=True" if name in _FLAGS else name

    return _OPTION.sub(keyword, text)


@contextmanager
def keywords() -> Iterator[None]:
    """Within it, or within a function that it decorates, an InputError names keywords."""
    try:
        yield
    except InputError as error:
        told = in_words_of_python(str(error))
        if type(error) is not InputError or told == str(error):
            raise
        raise InputError(told) from error.__cause__
