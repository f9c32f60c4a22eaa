"""Reading text that somebody wrote: one clear line for whatever is wrong with the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsbench.errors import InputError

# Far more than any of ours has.
_MOST_BYTES = 1 << 26


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
        return json.loads(read_text(path, what))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as a {what} ({error})") from None
