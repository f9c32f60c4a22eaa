"""Text for messages and tables, and text that comes from outside."""

from __future__ import annotations

import re
from typing import Any

_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")
_ERROR_CHARS = 300
_MOST_CHARS = 100_000
# What a terminal obeys in place of showing it, what turns the direction of text, and halves of characters, which no
# table takes. Line ends and tabs are text.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def one_line(text: str) -> str:
    """An error's cause on one line, without memory addresses, so that equal failures read equal.

    Characters that are no plain text are written out, as in `\\x1b`.
    """
    return written_out(_ADDRESS.sub("0x…", " ".join(text.split()))[:_ERROR_CHARS])


def written_out(text: str) -> str:
    """The text with characters that are no plain text as in `\\x1b`."""
    return _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)


def fault_in_texts(value: Any) -> str:
    """What is wrong with a text in what JSON can hold, keys included; "" where all may be shown and stored."""
    left = [value]
    while left:
        one = left.pop()
        if isinstance(one, str):
            if len(one) > _MOST_CHARS:
                return f"a text of {len(one)} characters, at most {_MOST_CHARS} are allowed"
            if _UNSAFE.search(one):
                return f"control characters in the text {one_line(one):.80}"
        elif isinstance(one, dict):
            left += [*one.keys(), *one.values()]
        elif isinstance(one, list):
            left += one
    return ""
