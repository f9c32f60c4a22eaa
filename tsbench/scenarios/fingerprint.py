"""What the makers of scenes consist of: a digest of their source and of SUMO's version, for resuming a build."""

from __future__ import annotations

import hashlib
import inspect
from functools import cache
from pathlib import Path

from tsbench.scenarios.families.base import Placement
from tsbench.sim.sumo import sumo_version
from tsbench.sources import closure

_PARTS = ("geometry", "maps", "roads", "scenarios", "signs", "sim")
_NOT_MAKERS = (
    "fetch.py",
    "stats.py",
    "draw.py",
    "build.py",
    "plates.py",
    "overview.py",
    "verify.py",
    "picture.py",
    "calibration.py",
    "certificates.py",
)
_FAMILIES = "tsbench.scenarios.families"


def maker_fingerprint(placement: Placement) -> str:
    """SHA-256 over the sources that decide what a placement's scenes look like: those of other placements do not."""
    return _fingerprint(Path(inspect.getfile(type(placement))).stem)


@cache
def _fingerprint(module: str) -> str:
    root = Path(__file__).resolve().parent.parent
    families = root / "scenarios" / "families"
    own = set(closure([families / f"{module}.py"], [_FAMILIES]))
    digest = hashlib.sha256(sumo_version().encode())
    for part in _PARTS:
        for path in sorted((root / part).rglob("*.py")):
            makes = path in own if path.parent == families else _makes(path)
            if makes:
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _makes(path: Path) -> bool:
    return path.name not in _NOT_MAKERS or path.parent.name == "families"
