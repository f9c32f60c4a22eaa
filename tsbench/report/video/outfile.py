"""Files that a report writes: whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.files import tmp_path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A path beside `path` for the block to write, moved onto it if the block ends well and removed if not.

    Makes the folder. Raises InputError, one line, where it cannot be written.
    """
    part = tmp_path(path.with_name(f"{path.name}.{os.getpid()}"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        _remove(part)


def _remove(part: Path) -> None:
    # Where the folder itself could not be made there is nothing to remove, and the error above says so.
    if part.parent.is_dir():
        part.unlink(missing_ok=True)
