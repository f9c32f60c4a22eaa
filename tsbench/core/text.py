"""Text for messages and tables."""

from __future__ import annotations

import re

_ADDRESS = re.compile(r"0x[0-9a-fA-F]{6,}")
_ERROR_CHARS = 300


def one_line(text: str) -> str:
    """An error's cause on one line, without memory addresses, so that equal failures read equal."""
    line = _ADDRESS.sub("0x…", " ".join(text.split()))[:_ERROR_CHARS]
    # Half of a pair of code units is no character, and no table takes it.
    return line.encode(errors="backslashreplace").decode()
