"""Writing files so that a reader sees the old content or the new, never half of one."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError


@contextmanager
def io_errors_as_input_errors(path: Path) -> Iterator[None]:
    """Turns an OSError of the block into one line with the path and what to do."""
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or str(problem)
        hint = ""
        if problem.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            hint = "; finished episodes are kept: free some space and run the same command again"
        elif problem.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            hint = "; choose another folder with --out"
        raise InputError(f"{problem.filename or path}: {reason}{hint}") from problem


def tmp_path(path: Path) -> Path:
    """Where a file is written before it takes its place; recognised by `is_tmp`."""
    return path.with_name(f".{path.name}.tmp")


def is_tmp(name: str) -> bool:
    """Is this one of our own half-written files?"""
    return name.startswith(".") and name.endswith(".tmp")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path for the block to write; synced and moved onto `path` if the block ends well."""
    tmp = tmp_path(path)
    yield tmp
    with tmp.open("rb+") as file:
        os.fsync(file.fileno())
    tmp.replace(path)
    sync_folder(path.parent)


def sync_folder(path: Path) -> None:
    """Make names in a folder outlast a power cut."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_atomic(path: Path, content: bytes) -> None:
    """Write a whole file."""
    with replacing(path) as tmp:
        tmp.write_bytes(content)


def write_json(path: Path, value: Any) -> None:
    """Write a JSON file that people can read."""
    write_atomic(path, (json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())
