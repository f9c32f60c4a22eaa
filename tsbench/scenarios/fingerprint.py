"""What the makers of scenes consist of: a digest of their source and of SUMO's version, for resuming a build."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from tsbench.sim.sumo import sumo_version

_PARTS = ("geometry", "maps", "scenarios", "signs", "sim")
_NOT_MAKERS = (
    "fetch.py",
    "stats.py",
    "draw.py",
    "build.py",
    "plates.py",
    "overview.py",
    "verify.py",
    "picture.py",
)


@cache
def maker_fingerprint() -> str:
    """SHA-256 over the source files that decide what a scene looks like."""
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(sumo_version().encode())
    for part in _PARTS:
        for path in sorted((root / part).rglob("*.py")):
            if path.name not in _NOT_MAKERS or path.parent.name == "families":
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
