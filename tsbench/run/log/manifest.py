"""`run.json`: what was asked, what took effect, with what, and how it ended."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tsbench
from tsbench.core import provenance
from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.core.textfile import read_json
from tsbench.core.typed import typed
from tsbench.episode.perception_level import Perception
from tsbench.metrics.aggregate import FLOOR
from tsbench.planners.builtin import origin
from tsbench.planners.registry import comes_with_tsbench
from tsbench.run import arithmetic, opened_files
from tsbench.run.contract import SCORING
from tsbench.run.edition import standing_contract
from tsbench.run.log.schema import SCHEMA_VERSION
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.table import SPLITS

Manifest = dict[str, Any]

NAME = "run.json"
# Of planners whose episodes share a process.
MAY_REMEMBER = "may remember"
_PACKAGES = {"sumo": "libsumo"} | {name: name for name in ("numpy", "pyarrow", "shapely", "torch")}
# What must be equal for a run to be continued in its folder.
_SAME = ("contract", "planners", "effective")
_STATES = frozenset(("running", "interrupted", "complete"))
# What stands in a manifest, by kind. {}: a mapping with these keys and perhaps more, those with a question mark may be
# missing; [x]: a list of x; a tuple: one of several; a set: one of its words; a dataclass: exactly its fields.
_NONE = type(None)
_SHAPE: dict[str, Any] = {
    "contract": str,
    "status": _STATES,
    "planners": [PlannerInfo],
    "effective": {
        "city?": str, "split": frozenset(SPLITS), "scenarios?": int, "types?": [str], "variants?": str, "half?": str,
        "limit?": (int, _NONE), "trace?": str, "device?": str, "mask_signs?": bool, "memory_limit?": float,
        "collection?": str, "perception?": {"name": str, "right": float}, "isolate?": bool,
    },
    "sessions": [{"started?": str, "finished?": (str, _NONE), "status?": _STATES}],
    "files": (_NONE, {"episodes.parquet?": str, "violations.parquet?": str, "timing.parquet?": str}),
    "counts?": (_NONE, {"asked": int, "finished": int, "errors": int}),
    "later?": [{"planner": str, "opened": [str], "left": [str]}],
    "asked?": {}, "isolation?": {}, "git?": {}, "machine?": {}, "versions?": {"tsbench?": str},
    "started?": str, "finished?": (str, _NONE),
}  # fmt: skip
# Those of a run, which collections of other things lack.
_OF_RUNS = {
    "effective": {"scenarios": int, "types": [str], "variants": str, "trace": str, "mask_signs": bool}
}
_MOST = 2**53


def new_manifest(
    contract: str, asked: Mapping[str, Any], effective: Mapping[str, Any], planners: Sequence[PlannerInfo],
    edition: str = "",
) -> Manifest:  # fmt: skip
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
    return {"mask_signs": perception.mask_signs, **told}


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
        specs = [planner.spec for planner in planners_of(new)]
        return arithmetic.difference(old.get("arithmetic"), new["arithmetic"], specs, device)
    return None


def read_manifest(folder: Path, name: str = NAME) -> Manifest | None:
    """The manifest of a run folder, None if there is none. Raises InputError for one that is not ours."""
    path = folder / name
    if not (path.exists() or path.is_symlink()):
        return None
    manifest: Manifest = read_json(path, "run manifest")
    if not isinstance(manifest, dict) or "contract" not in manifest or "schema_version" not in manifest:
        raise InputError(f"{path}: not the manifest of a tsbench run")
    if manifest["schema_version"] != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {manifest['schema_version']!r:.80}, this tsbench reads {SCHEMA_VERSION}; "
            f"read it with {_maker(manifest)}, or run it again into another folder"
        )
    fault = _fault(manifest, _SHAPE, "")
    if not fault and "collection" not in manifest["effective"]:
        fault = _fault(manifest, _OF_RUNS, "")
    if fault:
        raise InputError(f"{path}: not the manifest of a tsbench run ({fault!r} is missing or malformed)")
    return manifest


def _fault(value: Any, shape: Any, where: str) -> str:
    """Which part of a value is not of a shape, "" if all are."""
    if isinstance(shape, tuple):
        faults = [_fault(value, one, where) for one in shape]
        return "" if "" in faults else faults[-1]
    if isinstance(shape, list):
        if not isinstance(value, list):
            return where
        faults = [_fault(one, shape[0], f"{where}[{k}]") for k, one in enumerate(value)]
        return next(filter(None, faults), "")
    if is_dataclass(shape) and isinstance(shape, type):
        try:
            typed(shape, value)
        except ValueError:
            return where
        return ""
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            return where
        for key, inner in shape.items():
            name = key.removesuffix("?")
            place = f"{where}.{name}" if where else name
            if name not in value:
                if name == key:
                    return place
            elif fault := _fault(value[name], inner, place):
                return fault
        return ""
    return "" if _is(value, shape) else where


def _is(value: Any, kind: Any) -> bool:
    if isinstance(kind, frozenset):
        return isinstance(value, str) and value in kind
    if kind in (int, float):
        # A truth value is no number; one that no counter reaches is none either.
        allowed = (int,) if kind is int else (int, float)
        return type(value) in allowed and abs(value) <= _MOST
    # Half of a pair of code units is text that no file and no terminal takes.
    return isinstance(value, kind) and (kind is not str or value.encode(errors="ignore").decode() == value)


def _maker(manifest: Mapping[str, Any]) -> str:
    """Which tsbench wrote it, as far as it says so."""
    found = manifest.get("versions")
    return (
        f"tsbench {found['tsbench']}" if isinstance(found, dict) and "tsbench" in found else "its own tsbench"
    )


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
