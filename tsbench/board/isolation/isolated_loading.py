"""What an isolated planner is, asked and hashed without a line of its code in this process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import tsbench
from tsbench.board.isolation.image import image_of
from tsbench.board.isolation.planner_files import PlannerFiles
from tsbench.board.isolation.process import IsolatedPlanner, PlannerProcess
from tsbench.board.isolation.sandbox_paths import (
    EXECUTABLE,
    command_of,
    module_file,
    source_of,
    source_places,
)
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.paths import expanded
from tsbench.core.provenance import MOST_BYTES, closure, digest
from tsbench.planners.registry import EXPERT, LoadedPlanner, entry, in_package, is_own
from tsbench.planners.weights import file_of
from tsbench.run import opened_files
from tsbench.run.planner_info import PlannerInfo, changed, check_unchanged

# Of its name, characters.
_LONGEST = 100


@dataclass(frozen=True)
class SandboxedPlanner:
    """A planner, and what of its sandbox took effect (for the run's manifest)."""

    planner: PlannerInfo
    effects: Mapping[str, Any]


def describe(spec: str, hidden: Sequence[Path] = (), only: Sequence[str] = ()) -> SandboxedPlanner:
    """What a planner is, by its own word, and the hashes of its code and weights, by ours. Raises InputError.

    only: lines of the files that it is to see (`PlannerInfo.files`); (): all.
    """
    inner = image_of(spec)[1]
    files = PlannerFiles(inner, hidden, _names(only))
    try:
        process = PlannerProcess(spec, hidden, files)
        facts = process.facts
        process.close()
    finally:
        files.remove()
    name = facts.name or _stem(inner)
    if len(name) > _LONGEST or "\n" in name:
        raise InputError(f"planner {spec!r}: says of itself what cannot be: {facts!r:.80}")
    remembers = facts.keeps_process and not begins_afresh(spec)
    # Isolated networks run on the CPU.
    info = PlannerInfo(
        name=name, spec=spec, served_on=(), weights_sha256=weights_hash(inner, facts.weights_file),
        code_sha256=code_hash(inner), privileged=facts.privileged,
        sign_access=facts.sign_access, floor=facts.floor,
        may_remember=remembers, files=files.lines,
    )  # fmt: skip
    return SandboxedPlanner(info, process.effects)


def files_place(spec: str) -> Path | None:
    """Where the files of a Python planner lie."""
    file = _file(spec)
    return opened_files.place_of(file) if file else None


def _file(spec: str) -> Path | None:
    """The file that a Python planner is written in, or None."""
    source = source_of(spec)
    file = Path(source) if source.endswith(".py") else module_file(source)
    return file if file is not None and file.is_file() else None


def _names(lines: Sequence[str]) -> frozenset[str] | None:
    return frozenset(opened_files.names(lines)) or None


def changed_files(spec: str, planner: PlannerInfo) -> list[str]:
    """Which of the files in its own folder that a planner is known by are missing here, or are others.

    spec: what to drive. planner: as a run describes it.
    """
    inner = image_of(spec)[1]
    if planner.files:
        here = PlannerFiles(inner, only=_names(planner.files))
        here.remove()
        return opened_files.names({*planner.files} - {*here.lines})
    place = files_place(inner)
    own = {
        name: line for line in planner.opened if not (name := line.partition("  ")[2]).startswith(("/", "~/"))
    }
    # A run names what lies there. Any other name would have a file of this machine's read for whoever wrote it.
    known = [
        line
        for name, line in own.items()
        if place and (place / expanded(name)).resolve().is_relative_to(place)
    ]
    return [*opened_files.names({*own.values()} - {*known}), *changed(known, place)]


def code_hash(spec: str) -> str | None:
    """SHA-256 (hex) of a planner's code, as a run in one process has it; of an executable that of its file.

    spec: without its image. Raises InputError for what is no executable file, and for one that is too large.
    """
    if spec.startswith(EXECUTABLE):
        path = Path(command_of(spec, "")[0])
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"planner {spec!r}: {path} has more than {MOST_BYTES >> 30} GiB")
        return sha256_of(path)
    if in_package(source_of(spec)):
        return None
    file = _file(spec)
    return digest(closure([file])) if file else None


def weights_hash(spec: str, file: str | None) -> str | None:
    """SHA-256 (hex) of the file of a registered planner's weights, or None.

    file: its name, by the planner's word, for one of another package: it is looked for in that package. The weights of
    what is named by its file or module count with its code, and those of a program are in it.
    """
    base = spec.removesuffix(EXPERT)
    if ":" in base:
        return None
    if source_of(spec).split(".")[0] == tsbench.__name__:
        weights = entry(base).weights
        return None if weights is None else sha256_of(file_of(weights))
    found = (path for place in source_places(spec) for path in sorted(place.rglob("*")))
    return next((sha256_of(path) for path in found if path.name == file and path.is_file()), None)


def begins_afresh(spec: str) -> bool:
    """Is a planner one of this package's? Not by its own word; one in an image is of the image's package."""
    image, inner = image_of(spec)
    return image is None and not inner.startswith(EXECUTABLE) and is_own(source_of(inner))


def load(
    planner: PlannerInfo, hidden: Sequence[str] = (), *, alone: bool = False, show: bool = False
) -> LoadedPlanner:
    """A planner for a worker of a run, whose own code runs in sandboxes only.

    alone: each episode has a new one. show: as for `PlannerProcess`, outside of workers.
    """
    places = [Path(place) for place in hidden]

    @cache
    def files() -> PlannerFiles:
        """The planner's files as they were when the run began: one copy for all of a worker's sandboxes."""
        copied = PlannerFiles(image_of(planner.spec)[1], places, _names(planner.files))
        if others := opened_files.names({*planner.files} - {*copied.lines}):
            copied.remove()
            raise InputError(
                f"planner {planner.spec!r}: {others[0]} has changed since the run began: start the run anew"
            )
        return copied

    def made() -> IsolatedPlanner:
        own = begins_afresh(planner.spec)
        return IsolatedPlanner(
            lambda: PlannerProcess(planner.spec, places, files(), show=show),
            own=own,
            alone=alone,
            keeps=planner.may_remember,
        )

    return LoadedPlanner(
        name=planner.name,
        privileged=planner.privileged,
        sign_access=planner.sign_access,
        floor=planner.floor,
        spec=planner.spec,
        factory=made,
    )


def check_unchanged_since(planner: PlannerInfo, code: str | None) -> None:
    """As `planner_info.check_unchanged`, without running a line of the planner's code.

    code: its hash by `code_hash` before. That is not always the planner's `code_sha256`: code that extends Python's
    path may import files that are not found without running it.
    """
    inner = image_of(planner.spec)[1]
    check_unchanged(replace(planner, code_sha256=code), code_hash(inner), files_place(inner))


def load_alone(planner: PlannerInfo, hidden: Sequence[str] = ()) -> LoadedPlanner:
    """As `load`, with a new sandbox for each episode."""
    return load(planner, hidden, alone=True)


def _stem(spec: str) -> str:
    return Path(spec.removeprefix(EXECUTABLE)).stem
