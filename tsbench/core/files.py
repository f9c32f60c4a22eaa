"""Writing files so that a reader sees the old content or the new, never half of one."""

from __future__ import annotations

import errno
import hashlib
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
        named = Path(problem.filename or path)
        raise InputError(f"{path if is_tmp(named.name) else named}: {reason}{hint}") from problem


def is_tmp(name: str) -> bool:
    """Is this one of our own half-written files?"""
    return name.startswith(".") and name.endswith(".tmp")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` for the block to write; synced and moved onto it if the block ends well.

    Makes the folder. What a block that raises has written is gone; what a killed process leaves, `is_tmp` knows.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    tmp = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield tmp
        with tmp.open("rb+") as file:
            os.fsync(file.fileno())
        tmp.replace(path)
        sync_folder(path.parent)
    finally:
        tmp.unlink(missing_ok=True)


def sync_folder(path: Path) -> None:
    """Make names in a folder outlast a power cut."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_atomic(path: Path, content: bytes) -> None:
    with replacing(path) as tmp:
        tmp.write_bytes(content)


def write_json(path: Path, value: Any, *, indent: int | None = 2, sort_keys: bool = False) -> None:
    text = json.dumps(value, indent=indent, sort_keys=sort_keys, ensure_ascii=False, allow_nan=False)
    write_atomic(path, f"{text}\n".encode())


def sha256_of(path: Path) -> str:
    """SHA-256 (hex) of a file, without holding it in memory."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
