"""`run.json`: what was asked, what took effect, with what, and how it ended."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Required, TypedDict

from msgspec import Meta

import tsbench
from tsbench.core import provenance
from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.core.textfile import read_json
from tsbench.core.typed import typed
from tsbench.episode.perception_level import Perception, PerceptionLevel
from tsbench.metrics.aggregate import FLOOR
from tsbench.planners.builtin import origin
from tsbench.planners.registry import comes_with_tsbench
from tsbench.run import arithmetic, opened_files
from tsbench.run.edition import SCORING, standing_contract
from tsbench.run.log.record import SCHEMA_VERSION
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import SplitName

Manifest = dict[str, Any]

NAME = "run.json"
# Of planners whose episodes share a process.
MAY_REMEMBER = "may remember"
_PACKAGES = {"sumo": "libsumo"} | {name: name for name in ("numpy", "pyarrow", "shapely", "torch")}
# What must be equal for a run to be continued in its folder.
_SAME = ("contract", "planners", "effective")
# Parts of `effective` that collections of other things than episodes lack.
_OF_RUNS = ("scenarios", "types", "variants", "trace", "mask_signs")
_Whole = Annotated[int, Meta(ge=-(2**53), le=2**53)]
_Real = Annotated[float, Meta(ge=-(2.0**53), le=2.0**53)]
_State = Literal["running", "interrupted", "complete"]


class _Effective(TypedDict, total=False):
    city: str
    split: Required[SplitName]
    scenarios: _Whole
    types: list[str]
    variants: str
    half: str
    limit: _Whole | None
    trace: str
    device: str
    mask_signs: bool
    memory_limit: _Real
    collection: str
    perception: PerceptionLevel
    isolate: bool


class _Session(TypedDict, total=False):
    started: str
    finished: str | None
    status: _State


class _Counts(TypedDict):
    asked: _Whole
    finished: _Whole
    errors: _Whole


class _Versions(TypedDict, total=False):
    tsbench: str


class _Later(TypedDict):
    planner: str
    opened: list[str]
    left: list[str]


class _Shape(TypedDict, total=False):
    """What stands in a manifest, and perhaps more."""

    contract: Required[str]
    status: Required[_State]
    planners: Required[list[PlannerInfo]]
    effective: Required[_Effective]
    sessions: Required[list[_Session]]
    files: Required[dict[str, str] | None]
    counts: _Counts | None
    later: list[_Later]
    asked: dict[str, Any]
    isolation: dict[str, Any]
    git: dict[str, Any]
    machine: dict[str, Any]
    versions: _Versions
    started: str
    finished: str | None


def new_manifest(
    contract: str,
    asked: Mapping[str, Any],
    effective: Mapping[str, Any],
    planners: Sequence[PlannerInfo],
    edition: str = "",
) -> Manifest:
    """A manifest as of now. effective: every option that can change a record, with its defaults filled in.

    edition: the contract's name, "" for what is no run of an edition.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "edition": edition,
        "contract": contract,
        "scoring": SCORING,
        "status": "running",
        "planners": plain_planners(planners),
        "asked": dict(asked),
        "effective": dict(effective),
        "versions": versions(),
        "git": git_state(),
        "machine": machine(),
        "arithmetic": arithmetic.facts(),
        "started": timestamp(),
        "finished": None,
        "sessions": [],
        "counts": None,
        "files": None,
    }


def plain_planners(planners: Sequence[PlannerInfo]) -> list[dict[str, Any]]:
    """Planners as they stand in a manifest, which `planners_of` reads."""
    return [
        {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(planner).items()}
        for planner in planners
    ]


def planners_of(manifest: Mapping[str, Any]) -> list[PlannerInfo]:
    """The planners of a manifest, in the order of the command."""
    found = [typed(PlannerInfo, planner) for planner in manifest["planners"]]
    # Runs from before there were scoring numbers have a hash for the code of tsbench's own.
    return [replace(one, code_sha256=None) if comes_with_tsbench(one.spec) else one for one in found]


def marks_of(manifest: Mapping[str, Any]) -> dict[str, str]:
    """What tables write behind the names of a run's planners: of floors, of those that others made, and of those that
    may remember earlier episodes, or left something outside their process in one (`later`).

    By name; the others have none. Where a planner is from is not in the manifest: its registered name says it.
    """
    left = {told["planner"] for told in manifest.get("later", []) if told["left"]}
    marks = {
        planner.name: (
            FLOOR if planner.floor else origin(planner.spec),
            MAY_REMEMBER * (planner.may_remember or planner.name in left),
        )
        for planner in planners_of(manifest)
    }
    return {name: mark for name, words in marks.items() if (mark := ", ".join(filter(None, words)))}


def plain_perception(perception: Perception) -> dict[str, Any]:
    """How plates reach a run's planners, as it stands in `effective`; exact perception is left out."""
    level = perception.level
    told = {} if level is None else {"perception": json.loads(json.dumps(asdict(level)))}
    return {"mask_signs": perception.masked, **told}


def perception_of(manifest: Mapping[str, Any]) -> Perception:
    """How plates reached a run's planners."""
    effective = manifest["effective"]
    told = effective.get("perception")
    return Perception(effective["mask_signs"], None if told is None else typed(PerceptionLevel, told))


def city_of(manifest: Mapping[str, Any]) -> str:
    """Whose data set a run drove."""
    return str(manifest["effective"].get("city", OWN_CITY))


def identity(manifest: Mapping[str, Any]) -> str:
    """SHA-256 (hex) of what must be equal for a run to be continued."""
    same = json.dumps([manifest[part] for part in _SAME], sort_keys=True)
    return hashlib.sha256(same.encode()).hexdigest()


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str | None:
    """In what two runs differ, as "WHAT is A, not B"; None if one may continue the other.

    Of `new` only the parts that it has are compared.
    """
    for part in _SAME:
        if part not in new:
            continue
        if part == "effective":
            for key in sorted({*old[part], *new[part]}):
                if old[part].get(key) != new[part].get(key):
                    return f"{key} is {_short(old[part].get(key))}, not {_short(new[part].get(key))}"
        elif part == "planners":
            if planners_of(old) != planners_of(new):
                return _planner_difference(planners_of(old), planners_of(new))
        elif standing_contract(old[part]) != standing_contract(new[part]):
            return f"contract is {old[part][:12]}, not {new[part][:12]} (scoring, scenes or versions have changed)"
    # Nothing is driven beside complete rows.
    if "arithmetic" in new and old.get("status") != "complete":
        device = str(new["effective"].get("device", "cpu"))
        planners = planners_of(new)
        specs = [planner.spec for planner in planners]
        # In this process where they were described; an isolated one elsewhere.
        torch = "torch" in sys.modules or any("torch" in planner.unseen for planner in planners)
        found = arithmetic.differences(old.get("arithmetic"), new["arithmetic"], specs, device, torch)
        return next(iter(found), None)
    return None


def read_manifest(folder: Path) -> Manifest | None:
    """The manifest of a run folder, or None. Raises InputError for one that is not ours."""
    path = folder / NAME
    if not (path.exists() or path.is_symlink()):
        return None
    # Reading it would wait for a writer.
    if path.is_fifo():
        raise InputError(f"{path}: is a pipe, not the manifest of a tsbench run")
    manifest: Manifest = read_json(path, "run manifest")
    if not isinstance(manifest, dict) or "contract" not in manifest or "schema_version" not in manifest:
        raise InputError(f"{path}: not the manifest of a tsbench run")
    if manifest["schema_version"] != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {manifest['schema_version']!r:.80}, this tsbench reads {SCHEMA_VERSION}; "
            f"read it with {_maker(manifest)}, or run it again into another folder"
        )
    try:
        typed(_Shape, manifest, more=True)
        missing = [key for key in _OF_RUNS if key not in manifest["effective"]]
        if missing and "collection" not in manifest["effective"]:
            raise ValueError(f"effective: {missing[0]}: is missing")
        planners_of(manifest)
    except ValueError as problem:
        raise InputError(f"{path}: not the manifest of a tsbench run ({problem})") from None
    return manifest


def _maker(manifest: Mapping[str, Any]) -> str:
    """Which tsbench wrote it, as far as it says so."""
    found = manifest.get("versions")
    return f"tsbench {found['tsbench']}" if isinstance(found, dict) and "tsbench" in found else "its own tsbench"


def versions() -> dict[str, str | None]:
    """Versions of what decides results, None for what is not installed."""
    found = provenance.versions(_PACKAGES.values())
    own = {"tsbench": tsbench.__version__, "python": platform.python_version()}
    return own | {name: found[package] for name, package in _PACKAGES.items()}


def git_state() -> dict[str, Any]:
    """Commit of the clone that tsbench runs from, and whether files differ from it; nulls outside a clone."""
    root = Path(tsbench.__file__).parent.parent
    commit = _git(root, "rev-parse", "HEAD")
    changes = _git(root, "status", "--porcelain", "--untracked-files=no")
    return {"commit": commit, "modified": None if commit is None else bool(changes)}


def _git(root: Path, *arguments: str) -> str | None:
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        # A manifest without a commit is still a manifest.
        return None


def machine() -> dict[str, Any]:
    """Kind of machine; no names of hosts or people."""
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gib": round(pages / 2**30, 1),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def timestamp() -> str:
    """Now, UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _planner_difference(old: Sequence[PlannerInfo], new: Sequence[PlannerInfo]) -> str:
    specs = [p.spec for p in old], [p.spec for p in new]
    if specs[0] != specs[1]:
        return f"planners are {', '.join(specs[0])}, not {', '.join(specs[1])}"
    before, now = next((p, q) for p, q in zip(old, new, strict=True) if p != q)
    names = opened_files.names({*before.opened, *before.files} ^ {*now.opened, *now.files})
    what = f"its files: {', '.join(names[:3])}" if names else "its code or weights"
    return f"planner {now.spec} has changed since ({what})"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
