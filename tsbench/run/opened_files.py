"""Which files a planner opened: a run knows it by what is in them, as by its code.

And what it left outside its process, by which an episode could tell another one something.
"""

from __future__ import annotations

import os
import site
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import FrameType

import platformdirs

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.paths import expanded, roots
from tsbench.core.text import one_line

_PACKAGE = Path(tsbench.__file__).resolve().parent
_INSTALLED = ("site-packages", "dist-packages")
_DATA = ("cities", "scenarios", "sign_catalog", "sumo_nets")
_SYSTEM = ("/dev", "/etc", "/proc", "/sys", "/usr")
# Events of Python after which something is left outside the process; files that are opened to be written are others.
_LEAVES = frozenset((
    "ctypes.dlsym", "fcntl.fcntl", "os.chflags", "os.chmod", "os.chown", "os.exec", "os.fork", "os.forkpty",
    "os.kill", "os.killpg", "os.link", "os.mkdir", "os.posix_spawn", "os.remove", "os.removexattr", "os.rename",
    "os.rmdir", "os.setxattr", "os.symlink", "os.system", "os.truncate", "os.utime", "resource.prlimit",
    "socket.bind", "socket.connect", "socket.sendmsg", "socket.sendto", "sqlite3.connect", "subprocess.Popen",
    "syslog.syslog",
))  # fmt: skip
_OF_PATHS = ("open", "os.ch", "os.link", "os.mk", "os.r", "os.set", "os.sym", "os.t", "os.u", "sqlite3.")
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
# Where nothing stays.
_SINKS = ("/dev/null", "/dev/stdout", "/dev/stderr", "/dev/tty")
_MOST_LEFT, _LONGEST = 20, 200
# A hook stays for as long as its process: there is one, and mostly it notes nothing.
_notes: _Notes | None = None
_hooked = False


@dataclass
class Opened:
    """files: real paths of what, imports aside, was opened to be read and not written, in their order. unseen: packages
    that came with code of their own in C, C++ or Rust, which may have opened files that are not among them. left: the
    first things that the block left outside the process, each as the event of Python and its object. foreign: places
    whose files are not the planner's, as they were before the block, which may change the environment.
    """

    files: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    foreign: frozenset[Path] = frozenset()


@dataclass
class _Notes:
    """files: what was opened, and whether to be written. leaves: called at each thing in `left`. by_ctypes: was a
    function of a C library asked for?
    """

    leaves: Callable[[], None]
    files: list[tuple[Path, bool]] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    by_ctypes: bool = False


@contextmanager
def noted(leaves: Callable[[], None] = lambda: None) -> Iterator[Opened]:
    """What the Python code of this process opens and leaves in the block; filled at its end.

    leaves: called as soon as something is left, in case that the block does not end.
    """
    global _notes, _hooked
    if not _hooked:
        sys.addaudithook(_hook)
        _hooked = True
    opened, modules = Opened(foreign=_foreign()), set(sys.modules)
    _notes = notes = _Notes(leaves)
    try:
        yield opened
    finally:
        _notes = None
        real = [(os.path.realpath(path), writes) for path, writes in notes.files]
        written = {path for path, writes in real if writes}
        opened.files = tuple(sorted({path for path, _ in real} - written))
        opened.left = tuple(dict.fromkeys(notes.left))
        unseen = {_native(module) for module in sys.modules.keys() - modules} - {""}
        # What it calls by these stays unseen, also later.
        opened.unseen = tuple(sorted(unseen | {"ctypes"} if notes.by_ctypes else unseen))


def _hook(event: str, arguments: tuple[object, ...]) -> None:
    notes = _notes
    if notes is None:
        return
    if event == "open":
        path, _, flags = arguments
        if isinstance(path, str | bytes) and isinstance(flags, int):
            writes = bool(flags & _WRITES)
            # Imported code counts by `core.provenance`; of a large library it is thousands of files.
            if writes or not _imports(sys._getframe(1)):
                notes.files.append((_absolute(path), writes))
            if writes:
                _leave(notes, event, path)
    elif event in _LEAVES:
        # A link and a rename leave something where they lead to; before an address stands its socket.
        second = event in ("ctypes.dlsym", "os.link", "os.rename", "os.symlink") or event.startswith("socket.")
        thing = arguments[second] if arguments else ""
        # Memory of sqlite's is the process's own, and a message without an address goes where a socket is connected.
        if thing not in (None, ":memory:"):
            _leave(notes, event, thing)


def _leave(notes: _Notes, event: str, thing: object) -> None:
    notes.by_ctypes |= event == "ctypes.dlsym"
    path = None
    if isinstance(thing, str | bytes | os.PathLike) and event.startswith(_OF_PATHS):
        path = _absolute(os.fspath(thing))
    # Python itself caches code that it imports.
    cached = _imports(sys._getframe(2)) and path is not None and "__pycache__" in path.parts
    if path is not None and (str(path) in _SINKS or cached):
        return
    notes.leaves()
    if len(notes.left) < _MOST_LEFT:
        text = repr(thing) if path is None else _shown(Path(os.path.realpath(path)))
        notes.left.append(one_line(f"{event} {text}")[:_LONGEST])


def _imports(frame: FrameType) -> bool:
    """Does the import system run in a frame?"""
    return frame.f_code.co_filename.startswith("<frozen importlib")


def _absolute(path: str | bytes) -> Path:
    named = Path(os.fsdecode(path))
    # In a folder that is gone no relative name can be opened.
    return named if named.is_absolute() else Path.cwd() / named


def _native(module: str) -> str:
    """The package that a module of machine code comes with, "" for another module, a private one and Python's own."""
    origin = getattr(getattr(sys.modules.get(module), "__spec__", None), "origin", None) or ""
    package = module.partition(".")[0]
    hidden = package.startswith("_") or package in sys.stdlib_module_names
    return package if origin.endswith(tuple(EXTENSION_SUFFIXES)) and not hidden else ""


def place_of(file: Path) -> Path | None:
    """Where the files of a planner lie whose code is `file`: its folder, the outermost one of a package.

    None for a part of tsbench, whose files count otherwise, and for a module that was installed by itself.
    """
    place = file.resolve().parent
    while (place / "__init__.py").is_file() and (place.parent / "__init__.py").is_file():
        place = place.parent
    return None if _PACKAGE in (place, *place.parents) or place.name in _INSTALLED else place


def of_planner(files: Iterable[str], place: Path | None, foreign: frozenset[Path] | None = None) -> dict[str, Path]:
    """Those of such files that belong to a planner, by name.

    place: see `place_of`. A file there is named from it, another one by its path, with `~` for the home folder.
    foreign: as in `Opened`; None: those of now.
    What belongs to Python, to installed packages, to the system and to tsbench does not count, nor do caches and
    settings, wherever their folders are: a virtual environment may lie in the planner's folder.
    """
    found: dict[str, Path] = {}
    elsewhere = _foreign() if foreign is None else foreign
    for path in {Path(os.path.realpath(file)) for file in files}:
        own = place is not None and place in path.parents
        above = set(path.parents) - ({place, *place.parents} if own and place else set())
        if elsewhere.isdisjoint(above):
            found[str(path.relative_to(place)) if own and place else _shown(path)] = path
    return found


def hashes(files: Iterable[str], place: Path | None) -> tuple[str, ...]:
    """SHA-256 (hex), two spaces and name of each file that `of_planner` finds and that is there, in order of names.

    Raises InputError for a file that cannot be read.
    """
    digests = {name: _digest(path) for name, path in of_planner(files, place).items()}
    return tuple(f"{digests[name]}  {name}" for name in sorted(digests) if digests[name])


def names(lines: Iterable[str]) -> list[str]:
    """The names in such lines, each once, in order."""
    return sorted({line.partition("  ")[2] for line in lines})


def what_is_unseen(packages: Iterable[str]) -> str:
    """What to add to a sentence on a planner's files; "" where all of them were seen."""
    told = ", ".join(packages)
    return f"; files not seen: what {told} may open without Python" if told else ""


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
        raise InputError(f"{path}: the planner opened it, and it cannot be hashed: {problem.strerror}") from None


def _foreign() -> frozenset[Path]:
    data = ((root / name).resolve() for root in roots() for name in _DATA)
    return frozenset((_PACKAGE, *data)) | _of_others()


@cache
def _of_others() -> frozenset[Path]:
    told = [*_SYSTEM, sys.prefix, sys.base_prefix, *site.getsitepackages(), site.getusersitepackages()]
    told += map(str, (platformdirs.user_cache_path(), platformdirs.user_config_path()))
    return frozenset(Path(place).resolve() for place in told)
