"""What a sandbox is made of: which files a planner's process finds, and under which limits it runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from site import getsitepackages

import tsbench
from tsbench.core.machine import ONE_THREAD
from tsbench.core.paths import data_file, installed_data, roots
from tsbench.planners.planner_spec import PlannerSpec, parts_of

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
    return [str(program)] if program else [python, "-P", "-m", "tsbench.board.isolation.client", _absolute(spec)]


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
