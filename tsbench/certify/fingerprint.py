"""Digest of the code that drives and judges a proof: certificates of different code are not compared."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import tsbench
from tsbench.run.contract import code_hash
from tsbench.sim.sumo import sumo_version

_DRIVERS = ("planners", "certify")


@cache
def driving_fingerprint() -> str:
    """SHA-256 (hex) over the episode's code, the planners', the certificate's, and SUMO's version."""
    root = Path(tsbench.__file__).parent
    digest = hashlib.sha256(f"{sumo_version()} {code_hash()}".encode())
    for part in _DRIVERS:
        for path in sorted((root / part).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
