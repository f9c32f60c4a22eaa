"""Digest of the code that drives and judges a proof: certificates of different code are not compared."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import tsbench
from tsbench.run.contract import code_hash
from tsbench.sim.sumo import sumo_version
from tsbench.sources import closure

# Who drives a proof: the tempted drivers and the experts.
_DRIVERS = ("planners/styles.py", "planners/expert.py", "planners/idm.py")


@cache
def driving_fingerprint() -> str:
    """SHA-256 (hex) over the episode's code, the planners', the certificate's, and SUMO's version."""
    root = Path(tsbench.__file__).parent
    digest = hashlib.sha256(f"{sumo_version()} {code_hash()}".encode())
    starts = [*(root / name for name in _DRIVERS), *(root / "certify").rglob("*.py")]
    for path in closure(starts, ["tsbench.planners", "tsbench.certify"]):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
