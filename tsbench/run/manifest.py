"""`run.json`: what was asked, what took effect, with what, and how it ended."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import tsbench
from tsbench.errors import InputError
from tsbench.run import arithmetic
from tsbench.run.schema import SCHEMA_VERSION

Manifest = dict[str, Any]

NAME = "run.json"
_PACKAGES = {
    "sumo": "libsumo",
    "numpy": "numpy",
    "pyarrow": "pyarrow",
    "shapely": "shapely",
    "torch": "torch",
}
# What must be equal for a run to be continued in its folder.
_SAME = ("contract", "planners", "effective")
_PARTS: dict[str, type | tuple[type, ...]] = {
    "contract": str, "planners": list, "effective": dict, "status": str, "sessions": list,
    "files": (dict, type(None)),
}  # fmt: skip


def new_manifest(
    contract: str,
    asked: Mapping[str, Any],
    effective: Mapping[str, Any],
    planners: Sequence[Mapping[str, Any]],
) -> Manifest:
    """A manifest as of now. effective: every option that can change a record, with its defaults filled in."""
    return {
        "schema_version": SCHEMA_VERSION,
        "contract": contract,
        "status": "running",
        "planners": [dict(planner) for planner in planners],
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
        elif part == "planners" and old[part] != new[part]:
            return _planner_difference(old[part], new[part])
        elif old[part] != new[part]:
            return (
                f"contract is {old[part][:12]}, not {new[part][:12]} (rules, scenes or versions have changed)"
            )
    if "arithmetic" in new:
        device = str(new["effective"].get("device", "cpu"))
        return arithmetic.difference(old.get("arithmetic"), new["arithmetic"], new["planners"], device)
    return None


def read_manifest(folder: Path, name: str = NAME) -> Manifest | None:
    """The manifest of a run folder, None if there is none. Raises InputError for one that is not ours."""
    path = folder / name
    try:
        manifest: Manifest = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as problem:
        raise InputError(f"{path}: cannot be read as a run manifest ({problem})") from None
    if not isinstance(manifest, dict) or "contract" not in manifest or "schema_version" not in manifest:
        raise InputError(f"{path}: not the manifest of a tsbench run")
    if manifest["schema_version"] != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {manifest['schema_version']}, this tsbench reads {SCHEMA_VERSION}; "
            f"read it with {_maker(manifest)}, or run it again into another folder"
        )
    for name, kind in _PARTS.items():
        if not isinstance(manifest.get(name), kind):
            raise InputError(f"{path}: not the manifest of a tsbench run ({name!r} is missing or malformed)")
    return manifest


def _maker(manifest: Mapping[str, Any]) -> str:
    """Which tsbench wrote it, as far as it says so."""
    found = manifest.get("versions")
    return (
        f"tsbench {found['tsbench']}" if isinstance(found, dict) and "tsbench" in found else "its own tsbench"
    )


def versions() -> dict[str, str | None]:
    """Versions of what decides results, None for what is not installed."""
    found: dict[str, str | None] = {"tsbench": tsbench.__version__, "python": platform.python_version()}
    for name, package in _PACKAGES.items():
        try:
            found[name] = version(package)
        except PackageNotFoundError:
            found[name] = None
    return found


def git_state() -> dict[str, Any]:
    """Commit of the clone that tsbench runs from, and whether files differ from it; nulls outside a clone."""
    root = Path(tsbench.__file__).parent.parent
    commit = _git(root, "rev-parse", "HEAD")
    changes = _git(root, "status", "--porcelain", "--untracked-files=no")
    return {"commit": commit, "modified": None if commit is None else bool(changes)}


def _git(root: Path, *arguments: str) -> str | None:
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        # A manifest without a commit is still a manifest.
        return None
    return done.stdout.strip()


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


def _planner_difference(old: Sequence[Mapping[str, Any]], new: Sequence[Mapping[str, Any]]) -> str:
    before, now = [p["spec"] for p in old], [p["spec"] for p in new]
    if before != now:
        return f"planners are {', '.join(before)}, not {', '.join(now)}"
    changed = next(p["spec"] for p, q in zip(old, new, strict=True) if p != q)
    return f"planner {changed} has changed since (its code or weights)"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
