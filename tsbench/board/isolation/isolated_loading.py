"""What an isolated planner is, asked and hashed without a line of its code in this process."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import tsbench
from tsbench.board.isolation.process import IsolatedPlanner, PlannerProcess
from tsbench.board.isolation.sandbox_contents import PlannerFiles
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.core.paths import expanded
from tsbench.planners.planner_spec import EXECUTABLE, PlannerSpec
from tsbench.planners.registry import LoadedPlanner, entry, is_own, source_of
from tsbench.planners.weights import file_of
from tsbench.run import opened_files
from tsbench.run.planner_info import PlannerInfo, SandboxedPlanner, changed, code_hash_of, files_place, source_places

# Of its name, characters.
_LONGEST = 100


def describe(spec: str, hidden: Sequence[Path] = (), only: Sequence[str] = ()) -> SandboxedPlanner:
    """What a planner is, by its own word, and the hashes of its code and weights, by ours. Raises InputError.

    only: lines of the files that it is to see (`PlannerInfo.files`); (): all.
    """
    inner = PlannerSpec.parse(spec).text
    files = PlannerFiles(inner, hidden, _names(only))
    try:
        process = PlannerProcess(spec, hidden, files)
        facts = process.facts
        process.close()
    finally:
        files.remove()
    name = facts.name or Path(inner.removeprefix(EXECUTABLE)).stem
    if len(name) > _LONGEST or "\n" in name:
        raise InputError(f"planner {spec!r}: says of itself what cannot be: {facts!r:.80}")
    remembers = facts.keeps_process and not begins_afresh(spec)
    # Isolated networks run on the CPU.
    info = PlannerInfo(
        name=name,
        spec=spec,
        served_on=(),
        weights_sha256=weights_hash(inner, facts.weights_file),
        code_sha256=code_hash_of(inner),
        privileged=facts.privileged,
        sign_access=facts.sign_access,
        floor=facts.floor,
        may_remember=remembers,
        files=files.lines,
    )
    return SandboxedPlanner(info, process.effects)


def _names(lines: Sequence[str]) -> frozenset[str] | None:
    return frozenset(opened_files.names(lines)) or None


def changed_files(spec: str, planner: PlannerInfo) -> list[str]:
    """Which of the files in its own folder that a planner is known by are missing here, or are others.

    spec: what to drive. planner: as a run describes it.
    """
    inner = PlannerSpec.parse(spec).text
    if planner.files:
        here = PlannerFiles(inner, only=_names(planner.files))
        here.remove()
        return opened_files.names({*planner.files} - {*here.lines})
    place = files_place(inner)
    own = {name: line for line in planner.opened if not (name := line.partition("  ")[2]).startswith(("/", "~/"))}
    # A run names what lies there. Any other name would have a file of this machine's read for whoever wrote it.
    known = [line for name, line in own.items() if place and (place / expanded(name)).resolve().is_relative_to(place)]
    return [*opened_files.names({*own.values()} - {*known}), *changed(known, place)]


def weights_hash(spec: str, file: str | None) -> str | None:
    """SHA-256 (hex) of the file of a registered planner's weights, or None.

    file: its name, by the planner's word, for one of another package: it is looked for in that package. The weights of
    what is named by its file or module count with its code, and those of a program are in it.
    """
    base = PlannerSpec(spec).base
    if ":" in base:
        return None
    if source_of(spec).split(".")[0] == tsbench.__name__:
        weights = entry(base).weights
        return None if weights is None else sha256_of(file_of(weights))
    found = (path for place in source_places(spec) for path in sorted(place.rglob("*")))
    return next((sha256_of(path) for path in found if path.name == file and path.is_file()), None)


def begins_afresh(spec: str) -> bool:
    """Is a planner one of this package's? Not by its own word; one in an image is of the image's package."""
    parsed = PlannerSpec.parse(spec)
    return not parsed.isolated_only and is_own(source_of(parsed.text))


def load(planner: PlannerInfo, hidden: Sequence[str] = (), *, alone: bool = False, show: bool = False) -> LoadedPlanner:
    """A planner for a worker of a run, whose own code runs in sandboxes only.

    alone: each episode has a new one. show: as for `PlannerProcess`, outside of workers.
    """
    places = [Path(place) for place in hidden]

    @cache
    def files() -> PlannerFiles:
        """The planner's files as they were when the run began: one copy for all of a worker's sandboxes."""
        copied = PlannerFiles(PlannerSpec.parse(planner.spec).text, places, _names(planner.files))
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

    same = {field: getattr(planner, field) for field in ("name", "privileged", "sign_access", "floor", "spec")}
    return LoadedPlanner(**same, factory=made)


def load_alone(planner: PlannerInfo, hidden: Sequence[str] = ()) -> LoadedPlanner:
    """As `load`, with a new sandbox for each episode."""
    return load(planner, hidden, alone=True)
