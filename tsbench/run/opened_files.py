"""Which files a planner opened while it was made: a run knows it by what is in them, as by its code."""

from __future__ import annotations

import os
import site
import stat
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES, all_suffixes
from pathlib import Path

import platformdirs

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.home import expanded
from tsbench.core.paths import roots

# Code counts by its imports (`core.provenance`), and so do caches that Python makes of it.
_CODE = (*all_suffixes(), ".pyc")
_METADATA = (".dist-info", ".egg-info")
_PACKAGE = Path(tsbench.__file__).resolve().parent
_INSTALLED = ("site-packages", "dist-packages")
_DATA = ("cities", "scenarios", "sign_catalog", "sumo_nets")
_SYSTEM = ("/dev", "/etc", "/proc", "/sys", "/usr")
# A hook stays for as long as its process: there is one, and mostly it notes nothing.
_notes: list[tuple[Path, bool]] | None = None
_hooked = False


@dataclass
class Opened:
    """files: real paths of what was opened to be read and not written, in their order. unseen: packages that came
    with code of their own in C, C++ or Rust, which may have opened files that are not among them.
    """

    files: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()


@contextmanager
def noted() -> Iterator[Opened]:
    """What the Python code of this process opens in the block; filled at its end."""
    global _notes, _hooked
    if not _hooked:
        sys.addaudithook(_hook)
        _hooked = True
    opened, modules = Opened(), set(sys.modules)
    _notes = notes = list[tuple[Path, bool]]()
    try:
        yield opened
    finally:
        _notes = None
        real = [(os.path.realpath(path), writes) for path, writes in notes]
        written = {path for path, writes in real if writes}
        opened.files = tuple(sorted({path for path, _ in real} - written))
        opened.unseen = tuple(sorted(set(map(_native, sys.modules.keys() - modules)) - {""}))


def _hook(event: str, arguments: tuple[object, ...]) -> None:
    notes = _notes
    if event != "open" or notes is None:
        return
    path, _, flags = arguments
    if isinstance(path, str | bytes) and isinstance(flags, int):
        # In a folder that is gone no relative name can be opened.
        named = Path(os.fsdecode(path))
        absolute = named if named.is_absolute() else Path.cwd() / named
        notes.append((absolute, bool(flags & (os.O_WRONLY | os.O_RDWR))))


def _native(module: str) -> str:
    """The package that a module of machine code comes with, "" for another module, and for Python's own."""
    origin = getattr(getattr(sys.modules.get(module), "__spec__", None), "origin", None) or ""
    package = module.partition(".")[0]
    return (
        package
        if origin.endswith(tuple(EXTENSION_SUFFIXES)) and package not in sys.stdlib_module_names
        else ""
    )


def place_of(file: Path) -> Path | None:
    """Where the files of a planner lie whose code is `file`: its folder, the outermost one of a package.

    None for a part of tsbench, whose files count otherwise, and for a module that was installed by itself.
    """
    place = file.resolve().parent
    while (place / "__init__.py").is_file() and (place.parent / "__init__.py").is_file():
        place = place.parent
    return None if _PACKAGE in (place, *place.parents) or place.name in _INSTALLED else place


def hashes(files: Iterable[str], place: Path | None, only_there: bool = False) -> tuple[str, ...]:
    """SHA-256 (hex), two spaces and name of each file that belongs to a planner, by name.

    place: see `place_of`. A file there is named from it, another one by its path, with `~` for the home folder.
    only_there: no others. What belongs to Python, to installed packages, to the system and to tsbench does not count,
    nor do caches and settings. Raises InputError for a file that cannot be read.
    """
    lines: dict[str, str] = {}
    for path in {Path(os.path.realpath(file)) for file in files}:
        if _is_code(path) or not _of_tsbench().isdisjoint(path.parents):
            continue
        own = place is not None and place in path.parents
        if own or not (only_there or not _of_others().isdisjoint(path.parents)):
            name = str(path.relative_to(place)) if own and place else _shown(path)
            digest = _digest(path)
            if digest is not None:
                lines[name] = f"{digest}  {name}"
    return tuple(lines[name] for name in sorted(lines))


def _shown(path: Path) -> str:
    """A path as a manifest may name it: not whose home it is."""
    home = expanded("~")
    return f"~/{path.relative_to(home)}" if home in path.parents else str(path)


def _digest(path: Path) -> str | None:
    """None for what is no file, or none any more."""
    try:
        return sha256_of(path) if stat.S_ISREG(path.stat().st_mode) else None
    except FileNotFoundError:
        return None
    except OSError as problem:
        raise InputError(
            f"{path}: the planner opened it, and it cannot be hashed: {problem.strerror}"
        ) from None


def _is_code(path: Path) -> bool:
    return path.name.endswith(_CODE) or any(part.endswith(_METADATA) for part in path.parts)


def _of_tsbench() -> frozenset[Path]:
    return frozenset((_PACKAGE, *((root / name).resolve() for root in roots() for name in _DATA)))


@cache
def _of_others() -> frozenset[Path]:
    told = [*_SYSTEM, sys.prefix, sys.base_prefix, *site.getsitepackages(), site.getusersitepackages()]
    told += map(str, (platformdirs.user_cache_path(), platformdirs.user_config_path()))
    return frozenset(Path(place).resolve() for place in told)
