"""Where the random draws of a data set that is made come from: names, and the secret of a sealed one."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

from tsbench.core import seeds
from tsbench.core.errors import InputError
from tsbench.core.textfile import read_text

# Of this process and those that it starts: the file of the secret.
SECRET = "TSBENCH_SECRET"


@contextmanager
def using_secret(path: Path) -> Iterator[None]:
    """Draw with the secret in a file for as long as this lasts, here and in processes that are started meanwhile."""
    read_secret(path)
    os.environ[SECRET] = str(path.resolve())
    try:
        yield
    finally:
        del os.environ[SECRET]


def read_secret(path: Path) -> str:
    """The secret in a file. Raises InputError for any other content."""
    text = read_text(path, "secret").strip()
    if not re.fullmatch("[0-9a-f]{64}", text):
        raise InputError(f"{path}: is no secret, which is 64 digits of 0-9 and a-f: tsbench seal secret FILE makes one")
    return text


def secret_sha256(path: Path) -> str:
    """What may be published of a secret: it leads to no draw."""
    return hashlib.sha256(f"tsbench sealed split\n{read_secret(path)}".encode()).hexdigest()


def _secret() -> tuple[str, ...]:
    path = os.environ.get(SECRET)
    return (_kept(path),) if path else ()


@cache
def _kept(path: str) -> str:
    return read_secret(Path(path))


def seed_of(*names: object) -> int:
    """As `core.seeds.seed_of`; of a sealed data set another one, which needs its secret."""
    return seeds.seed_of(*_secret(), *names)


def rng_of(*names: object) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed_of(*names)))


def root_sequence(number: int) -> np.random.SeedSequence:
    """The draws of a data set as a whole, by a number of their own."""
    return np.random.SeedSequence([seeds.ROOT_SEED, number, *(int(secret, 16) for secret in _secret())])
