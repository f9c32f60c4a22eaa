"""What an isolated planner is, asked and hashed without a line of its code in this process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.provenance import closure, digest
from tsbench.planners.registry import EXPERT, EXPERT_MODULE, LoadedPlanner, entry, is_own
from tsbench.planners.weights import file_of
from tsbench.run import opened_files
from tsbench.run.contract import file_names
from tsbench.run.isolation.files import PlannerFiles
from tsbench.run.isolation.image import image_of
from tsbench.run.isolation.process import IsolatedPlanner, PlannerProcess
from tsbench.run.isolation.sandbox_paths import EXECUTABLE, module_file, source_of, source_places
from tsbench.run.planner_info import PlannerInfo, check_unchanged

# Of its name, characters; of lists of names, items.
_LONGEST, _MOST_NAMES = 100, 1000


@dataclass(frozen=True)
class SandboxedPlanner:
    """A planner, and what of its sandbox took effect (for the run's manifest)."""

    planner: PlannerInfo
    effects: Mapping[str, Any]


def describe(spec: str, hidden: Sequence[Path] = ()) -> SandboxedPlanner:
    """What a planner is, by its own word, and the hashes of its code and weights, by ours. Raises InputError."""
    process = PlannerProcess(spec, hidden)
    facts = process.facts
    process.close()
    image, inner = image_of(spec)
    name = facts.get("name") or _stem(inner)
    weights_file = facts.get("weights_file")
    if (
        not isinstance(name, str)
        or len(name) > _LONGEST
        or "\n" in name
        or not isinstance(weights_file, str | None)
    ):
        raise InputError(f"planner {spec!r}: says of itself what cannot be: {facts!r:.80}")
    remembers = facts.get("keeps_process") is True and not begins_afresh(spec)
    told = {key: bool(facts.get(key, key == "sign_access")) for key in ("privileged", "sign_access", "floor")}
    # Its network is its own: none is served by a process that others use too.
    info = PlannerInfo(
        name=name, spec=spec, served_on=(), weights_sha256=weights_hash(inner, weights_file),
        code_sha256=code_hash(inner), may_remember=remembers,
        opened=() if image else opened_here(inner, _names(facts, "opened")), unseen=_names(facts, "unseen"), **told
    )  # fmt: skip
    return SandboxedPlanner(info, process.effects)


def opened_here(spec: str, files: Sequence[str]) -> tuple[str, ...]:
    """Hashes of the files that a planner says it has opened, of those in its own folder, which are all that it can."""
    if spec.startswith(EXECUTABLE):
        return ()
    return opened_files.hashes(files, files_place(spec), only_there=True)


def files_place(spec: str) -> Path | None:
    """Where the files of a Python planner lie."""
    source = source_of(spec)
    file = Path(source) if source.endswith(".py") else module_file(source)
    return opened_files.place_of(file) if file else None


def _names(facts: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """Names by the planner's own word; InputError for what is no list of them."""
    told = facts.get(key, [])
    if (
        not isinstance(told, list)
        or len(told) > _MOST_NAMES
        or not all(isinstance(name, str) and "\0" not in name for name in told)
    ):
        raise InputError(f"planner: {key}: expected at most {_MOST_NAMES} names: {told!r:.80}")
    return tuple(told)


def code_hash(spec: str) -> str | None:
    """SHA-256 (hex) of a planner's code, as a run in one process has it; of an executable that of its file."""
    if spec.startswith(EXECUTABLE):
        return sha256_of(Path(spec.removeprefix(EXECUTABLE)))
    source = source_of(spec)
    sources = [source, *([EXPERT_MODULE] if spec.endswith(EXPERT) else [])]
    files = [Path(one) if one.endswith(".py") else module_file(one) for one in sources]
    found = [path for path in files if path is not None and path.is_file()]
    return digest(closure(found, file_names())) if found else None


def weights_hash(spec: str, file: str | None) -> str | None:
    """SHA-256 (hex) of the file of a registered planner's weights; None where there is none.

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

    alone: each episode has a new one. show: as for `PlannerProcess`, for who is no worker.
    """
    places = [Path(place) for place in hidden]

    @cache
    def files() -> PlannerFiles:
        """The planner's files as they were when the run began: one copy for all of a worker's sandboxes."""
        copied = PlannerFiles(image_of(planner.spec)[1], places)
        check_unchanged_now(planner)
        return copied

    def made() -> IsolatedPlanner:
        own = begins_afresh(planner.spec)
        return IsolatedPlanner(
            lambda: PlannerProcess(planner.spec, places, files(), show=show), own=own, alone=alone
        )

    return LoadedPlanner(
        name=planner.name, privileged=planner.privileged, sign_access=planner.sign_access, floor=planner.floor,
        spec=planner.spec, factory=made,
    )  # fmt: skip


def check_unchanged_now(planner: PlannerInfo) -> None:
    """As `planner_info.check_unchanged`, without running a line of the planner's code."""
    inner = image_of(planner.spec)[1]
    check_unchanged(planner, code_hash(inner), files_place(inner))


def load_alone(planner: PlannerInfo, hidden: Sequence[str] = ()) -> LoadedPlanner:
    """As `load`, with a new sandbox for each episode."""
    return load(planner, hidden, alone=True)


def _stem(spec: str) -> str:
    return Path(spec.removeprefix(EXECUTABLE)).stem
