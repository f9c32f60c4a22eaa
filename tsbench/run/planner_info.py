"""What a run writes down about a planner: what it is, and the hashes of its code, files and weights.

The code is the file that a planner is written in with all that it imports from beside it or from the path, and the data
files (weights, settings) that its code names, each by its bytes. Files that it opens while it is made have hashes of
their own. The code of tsbench's own planners has no hash: the scoring number of the contract speaks for it.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.machine import adopt_orphans
from tsbench.core.paths import expanded
from tsbench.core.provenance import MOST_BYTES, closure, digest
from tsbench.planners.base import DEVICES, Planner
from tsbench.planners.planner_spec import PlannerSpec, cause_with_place
from tsbench.planners.registry import LoadedPlanner, in_package, resolve, source_of
from tsbench.run import opened_files
from tsbench.run.execution.fresh_episode import shared_with_children


@dataclass(frozen=True, slots=True)
class PlannerInfo:
    """A planner in `run.json`. Hashes are SHA-256 (hex), None where there is nothing to hash.

    name: in records.
    spec: what the user wrote.
    served_on: devices that its network runs on besides the CPU.
    code_sha256: of its code; see this module.
    floor: as the planner's entry says; runs from before there were floors do not say.
    may_remember: its episodes share a process, and it may know in one what it met in another.
    opened: hashes and names of the files that it opens while it is made.
    unseen: packages that may have opened more (`run.opened_files`).
    files: of an isolated planner, SHA-256, mode and name of every file of its own that its sandbox shows.
    """

    name: str
    spec: str
    privileged: bool
    sign_access: bool
    served_on: tuple[str, ...]
    weights_sha256: str | None
    code_sha256: str | None
    floor: bool = False
    may_remember: bool = False
    opened: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class SandboxedPlanner:
    """A planner, and what of its sandbox took effect (for the run's manifest)."""

    planner: PlannerInfo
    effects: Mapping[str, Any]


def describe(spec: str, device: str = "cpu") -> PlannerInfo:
    """What a planner is. device: where its network runs.

    Raises InputError: there is no such planner, it does not import, or it cannot be made (a package is missing).
    """
    # A process that its parent has left is one that the planner has started, too.
    adopt_orphans()
    before = shared_with_children()
    with opened_files.noted() as opened:
        loaded = resolve(spec).on(device)
        planner = _make(loaded)
    shared = loaded.keeps_process or bool(shared_with_children() - before)
    del planner
    sources = _sources(loaded)
    return PlannerInfo(
        name=loaded.name,
        spec=loaded.spec,
        privileged=loaded.privileged,
        sign_access=loaded.sign_access,
        floor=loaded.floor,
        served_on=tuple(name for name in DEVICES if loaded.batched and name in loaded.batched.served_on),
        weights_sha256=None if loaded.weights is None else loaded.weights.sha256,
        code_sha256=_code_hash(sources),
        may_remember=shared and not loaded.own,
        opened=() if loaded.own else opened_files.hashes(opened.files, place_of(loaded)),
        unseen=() if loaded.own else opened.unseen,
    )


def resolve_unchanged(planner: PlannerInfo) -> LoadedPlanner:
    """A planner of a run, loaded. Raises InputError as `check_unchanged` does, too."""
    loaded = resolve(planner.spec)
    sources = _sources(loaded)
    check_unchanged(planner, _code_hash(sources), place_of(loaded))
    return loaded


def place_of(loaded: LoadedPlanner) -> Path | None:
    """Where the files of a planner lie, see `opened_files.place_of`."""
    sources = _sources(loaded)
    return opened_files.place_of(sources[0]) if sources else None


def check_unchanged(planner: PlannerInfo, code: str | None, place: Path | None) -> None:
    """Raises InputError where the code of a planner, or a file that it opened when it was described, is another now.

    code: its hash now. place: see `opened_files.place_of`.
    """
    now = [] if planner.code_sha256 in (None, code) else ["its code"]
    if now := [*now, *changed(planner.opened, place)]:
        raise InputError(f"planner {planner.spec!r}: {now[0]} has changed since the run began: start the run anew")


def changed(opened: Iterable[str], place: Path | None) -> list[str]:
    """Names of the files that are gone or are others now. opened: lines as in `PlannerInfo`."""
    found = []
    for line in opened:
        told, _, name = line.partition("  ")
        path = (place or Path()) / expanded(name)
        if not path.is_file() or path.stat().st_size > MOST_BYTES or sha256_of(path) != told:
            found.append(name)
    return found


def _sources(loaded: LoadedPlanner) -> list[Path]:
    """The files that a planner is written in, without those of tsbench."""
    others = (source for source in loaded.sources if not in_package(source))
    return [path for path in map(source_file, others) if path is not None]


def _code_hash(sources: Sequence[Path]) -> str | None:
    return digest(closure(sources)) if sources else None


def _make(loaded: LoadedPlanner) -> Planner:
    """Make one, network and all: what is missing is missing in every episode."""
    try:
        return loaded.factory()
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise InputError(f"planner {loaded.spec!r}: cannot be made: {cause_with_place(error)}") from error


def source_file(source: str) -> Path | None:
    """The file of a module (or file) that a planner is written in, None for what has none (built into Python)."""
    if source.endswith(".py"):
        return Path(source)
    found = importlib.util.find_spec(source)
    return Path(found.origin) if found and found.origin and Path(found.origin).is_file() else None


def code_hash_of(spec: str) -> str | None:
    """SHA-256 (hex) of a planner's code, as a run in one process has it; of an executable that of its file.

    spec: without its image. Raises InputError for what is no executable file, and for one that is too large.
    """
    if path := PlannerSpec(spec).executable():
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"planner {spec!r}: {path} has more than {MOST_BYTES >> 30} GiB")
        return sha256_of(path)
    if in_package(source_of(spec)):
        return None
    file = _own_file(spec)
    return _code_hash([file] if file else [])


def check_unchanged_since(planner: PlannerInfo, code: str | None) -> None:
    """As `check_unchanged`, without running a line of the planner's code.

    code: its hash by `code_hash_of` before. That is not always the planner's `code_sha256`: code that extends Python's
    path may import files that are not found without running it.
    """
    inner = PlannerSpec.parse(planner.spec).text
    check_unchanged(replace(planner, code_sha256=code), code_hash_of(inner), files_place(inner))


def files_place(spec: str) -> Path | None:
    """Where the files of a Python planner lie."""
    file = _own_file(spec)
    return opened_files.place_of(file) if file else None


def _own_file(spec: str) -> Path | None:
    """The file that a Python planner is written in, or None."""
    source = source_of(spec)
    file = Path(source) if source.endswith(".py") else _module_file(source)
    return file if file is not None and file.is_file() else None


def source_places(spec: str) -> list[Path]:
    """Files and folders that a planner's code lies in; nothing is imported to find them.

    The folder of a file; the outermost package of a module; an executable.
    """
    if program := PlannerSpec(spec).program:
        return [program]
    source = source_of(spec)
    if source.endswith(".py"):
        return [Path(source).resolve().parent]
    parts = source.split(".")
    # A namespace has no file: the first below it that has one is the outermost.
    files = (_module_file(".".join(parts[: k + 1])) for k in range(len(parts)))
    found = next(filter(None, files), None)
    if found is None:
        return []
    return [found.parent if found.name == "__init__.py" else found]


def _module_file(name: str) -> Path | None:
    """The file of a module, found without running any code of its packages."""
    path: list[str] | None = [*sys.path, str(Path.cwd())]
    origin = None
    parts = name.split(".")
    for k in range(len(parts)):
        spec = PathFinder.find_spec(".".join(parts[: k + 1]), path)
        if spec is None:
            return None
        path, origin = list(spec.submodule_search_locations or []), spec.origin
    return Path(origin) if origin else None
