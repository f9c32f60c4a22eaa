"""What a sandbox is made of: the files that a planner's process finds in it, and the limits under which it runs.

The planner's own regular files are copied once for many sandboxes: a planner that writes, swaps or links its files
while it is driven changes nothing in its next sandbox, and reading the copies needs no right of the user who starts the
run.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Collection, Iterable, Iterator, Sequence
from importlib.util import cache_from_source
from pathlib import Path
from site import getsitepackages

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.machine import ONE_THREAD, module_command
from tsbench.core.paths import data_file, expanded, installed_data, roots
from tsbench.core.provenance import closure_paths
from tsbench.planners.planner_spec import PlannerSpec, parts_of
from tsbench.planners.registry import source_of
from tsbench.run.execution.own_folder import FILES, OwnFolder
from tsbench.run.planner_info import source_places

_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/etc/alternatives")
# Of the data, what tells of scenes; planners' weights and the catalogue stay.
_DATA = ("scenarios", "sumo_nets", "cities", "runs", ".git")
# What decides which code a library picks for a processor, and with it last places of numbers.
_ARITHMETIC = ("ATEN_CPU_CAPABILITY", "GLIBC_TUNABLES", "MKL_", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_", "DNNL_")
_PACKAGE = Path(tsbench.__file__).resolve().parent
_PYTHON = (sys.prefix, sys.base_prefix)

MEMORY_BYTES = 4 << 30
# All the processor time of one process of a planner; it is replaced long before, between two episodes.
CPU_S = 6 * 3600
LIMITS = {"DATA": MEMORY_BYTES, "CPU": CPU_S, "NPROC": 256, "NOFILE": 256, "FSIZE": 64 << 20, "MSGQUEUE": 0}
SCRATCH_MB = 256


def environment_of() -> dict[str, str]:
    """The environment of a program in a sandbox, but for its home."""
    path = [entry for entry in sys.path if entry]
    own = {"PATH": "/usr/bin:/bin", "LANG": "C.UTF-8", "PYTHONPATH": os.pathsep.join(path), **arithmetic()}
    if "TSBENCH_DATA" in os.environ:
        own["TSBENCH_DATA"] = str(Path(os.environ["TSBENCH_DATA"]).absolute())
    return {**own, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONUNBUFFERED": "1"}


def arithmetic() -> dict[str, str]:
    """Of the environment what decides the last places of numbers."""
    return {**ONE_THREAD, **{name: value for name, value in os.environ.items() if name.startswith(_ARITHMETIC)}}


def command_of(spec: str, python: str) -> list[str]:
    """What is to run in a sandbox. python: its name there. Raises InputError for a file that cannot be executed."""
    program = PlannerSpec(spec).executable()
    return [str(program)] if program else [*module_command("tsbench.board.isolation.client", python), _absolute(spec)]


def _absolute(spec: str) -> str:
    """The same spec for a process in another folder."""
    kind, source, attribute = parts_of(spec)
    return f"{kind}{Path(source).resolve()}:{attribute}" if source.endswith(".py") else spec


def shown_to_all() -> list[Path]:
    """What a sandbox has for all planners."""
    return [Path(one) for one in (*_SYSTEM, *_PYTHON, str(_PACKAGE), str(data_file("sign_catalog")))]


def is_public(place: Path) -> bool:
    """May every user read a file, or look into a folder?"""
    wanted = 0o5 if place.is_dir() else 0o4
    return place.exists() and place.stat().st_mode & wanted == wanted


def is_installed(place: Path) -> bool:
    """Does a file or folder come with tsbench, or is it where pip installs?"""
    return is_of_tsbench(place) or any(place.is_relative_to(Path(one).resolve()) for one in getsitepackages())


def is_of_tsbench(place: Path) -> bool:
    """Does a file or folder lie in tsbench's package?"""
    return place.is_relative_to(_PACKAGE)


def covered(hidden: Sequence[Path]) -> list[Path]:
    """What no sandbox shows, wherever it lies: the data that tell of scenes, and `hidden`."""
    data = {place / name for place in (*roots(), *installed_data()) if place != _PACKAGE for name in _DATA}
    return sorted(data | {path.resolve() for path in hidden})


def binds_of(own: Sequence[tuple[Path, Path]]) -> list[tuple[str, str]]:
    """What a sandbox shows: (source, place), parents first.

    own: copies of the planner's own files, and where they are to stand. What lies in something that is installed, too,
    comes with that.
    """
    found = {str(place): str(copy) for copy, place in own}
    for place in sorted({str(path.absolute()) for path in shown_to_all()}, key=_depth):
        inside = any(place.startswith(f"{outer}/") for outer in found if not Path(outer).is_symlink())
        if not inside or any(place.startswith(f"{one}/") for _, one in own):
            found.setdefault(place, place)
    return [(found[place], place) for place in sorted(found, key=_depth)]


def _depth(place: str) -> tuple[int, str]:
    return place.count("/"), place


_MOST_FILES, _MOST_BYTES = 5_000, 8 << 30
_CACHES = "__pycache__"
_ENVIRONMENT = "pyvenv.cfg"


class PlannerFiles:
    """The copies; they go with this object.

    binds: (copy, place) of each file or folder: what is shown in the sandbox at `place` lies at `copy`. What is
    installed is copied, too: beside its files lie caches and hidden ones, which have no hash.
    lines: of each of these files SHA-256 (hex), mode and name, sorted by name; () for tsbench's own planners,
    which are not copied.
    """

    def __init__(self, spec: str, hidden: Sequence[Path] = (), only: Collection[str] | None = None) -> None:
        """Copy the files.

        hidden: files and folders that are not to be seen, such as the run.
        only: names, as in `lines`, of the files that are to be seen; None: all.

        Raises InputError for a file that cannot be read, and for a folder with too much in it.
        """
        apart = {path.resolve() for path in (*shown_to_all(), *covered(hidden))}
        # Any user in the sandbox may read the copies; the folder around them keeps all others out.
        self._folder = OwnFolder(FILES)
        self.binds: list[tuple[Path, Path]] = []
        found: dict[str, str] = {}
        try:
            for place in source_places(spec):
                if is_of_tsbench(place):
                    if os.geteuid() == 0 and not is_public(place):
                        raise InputError(
                            f"planner {spec!r}: only its owner may read {place}, and nobody is root in a sandbox: "
                            f"chmod -R go+rX {place}"
                        )
                elif place.is_dir() and not _is_shared(place):
                    copy = self._new_place(place.name)
                    self.binds.append((copy, place))
                    for name, path in _bounded(spec, place, _regular(place, apart), only):
                        target = copy / name
                        target.parent.mkdir(parents=True, exist_ok=True)
                        found[name] = _copied(path, target)
                    _finish_folder(place, copy, apart)
                else:
                    paths = _named(spec, place) if place.is_dir() else [place]
                    for name, path in _bounded(spec, place, paths, only):
                        copy = self._new_place(path.name)
                        self.binds.append((copy, path))
                        found[name] = _copied(path, copy)
                        self._hide_cache(path)
        except OSError as problem:
            raise InputError(
                f"planner {spec!r}: {problem.filename}: cannot be copied into its sandbox: {problem.strerror}"
            ) from None
        self.lines = tuple(f"{found[name]}  {name}" for name in sorted(found))

    def _hide_cache(self, path: Path) -> None:
        """Hide a module's cache behind an empty file: Python would run it, and it has no hash."""
        cache = Path(cache_from_source(str(path)))
        if path.suffix == ".py" and is_installed(path) and cache.is_file():
            empty = self._new_place(cache.name)
            empty.touch(0o644)
            self.binds.append((empty, cache))

    def _new_place(self, name: str) -> Path:
        folder = self._folder.path / str(len(self.binds))
        folder.mkdir()
        return folder / name

    def remove(self) -> None:
        """Remove the copies; nothing happens the second time."""
        self._folder.remove()


def _bounded(spec: str, place: Path, paths: Iterable[Path], only: Collection[str] | None) -> list[tuple[str, Path]]:
    """(name below the place, path) of those that are to be seen. InputError for too many, before any is read."""
    found, size = [], 0
    for path in paths:
        name = path.name if path == place else path.relative_to(place).as_posix()
        if only is not None and name not in only:
            continue
        found.append((name, path))
        size += path.stat().st_size
        if len(found) > _MOST_FILES or size > _MOST_BYTES:
            raise InputError(
                f"planner {spec!r}: {place} holds more than {_MOST_FILES:,} files or {_MOST_BYTES >> 30} GiB, and all "
                "of it would be shown to the planner: give the planner a folder of its own"
            )
    return found


def _finish_folder(place: Path, copy: Path, apart: set[Path]) -> None:
    """Folders that are left out are empty in the copy, and every user in the sandbox may look into all."""
    copy.mkdir(exist_ok=True)
    for one in sorted(apart):
        if one != place and one.is_relative_to(place) and one.is_dir():
            (copy / one.relative_to(place)).mkdir(parents=True, exist_ok=True)
    # Whatever the umask is.
    for folder, _, _ in os.walk(copy):
        Path(folder).chmod(0o755)


def _is_shared(place: Path) -> bool:
    """Is a folder one in which others' files lie: the root, a home, one for temporary files, or above such a one?"""
    kept = [Path(one).resolve() for one in (expanded("~"), tempfile.gettempdir(), "/var/tmp", "/dev/shm")]
    return any(one.is_relative_to(place) for one in kept) or place.parent == Path("/home")


def _named(spec: str, place: Path) -> Iterator[Path]:
    """Of a folder the files that count with the planner's code: its modules, and the data that they name."""
    source = source_of(spec)
    start = Path(source).resolve() if source.endswith(".py") else place / "__init__.py"
    for path in closure_paths([start]).values():
        if path.resolve().is_relative_to(place):
            yield path.resolve()


def _regular(place: Path, apart: set[Path]) -> Iterator[Path]:
    """Regular files below a folder, on its own file system; no hidden ones, no caches, no environments, no links."""
    device = place.stat().st_dev
    for folder, folders, files in os.walk(place, onerror=_raised):
        here = Path(folder)
        folders[:] = sorted(
            name
            for name in folders
            if not (name.startswith(".") or name == _CACHES or here / name in apart)
            and not (here / name / _ENVIRONMENT).exists()
            and (here / name).lstat().st_dev == device
        )
        for name in sorted(files):
            found = (here / name).lstat()
            if not name.startswith(".") and stat.S_ISREG(found.st_mode) and found.st_dev == device:
                yield here / name


def _raised(problem: OSError) -> None:
    raise problem


def _copied(source: Path, target: Path) -> str:
    """Copy a file for every user to read. Returns the SHA-256 (hex) of what was copied, and its mode.

    Raises OSError, also for what is no regular file any more, or grows meanwhile.
    """
    found = hashlib.sha256()
    with os.fdopen(os.open(source, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        state = os.fstat(file.fileno())
        if not stat.S_ISREG(state.st_mode):
            raise OSError(0, "no regular file", str(source))
        left = state.st_size
        mode = 0o755 if state.st_mode & 0o111 else 0o644
        with target.open("wb") as made:
            while piece := file.read(1 << 20):
                left -= len(piece)
                if left < 0:
                    raise OSError(0, "grows while it is read", str(source))
                found.update(piece)
                made.write(piece)
    target.chmod(mode)
    return f"{found.hexdigest()} {mode:o}"
