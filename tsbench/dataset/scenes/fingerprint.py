"""What the makers of scenes consist of: a digest of their code and versions, for resuming a build."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path

from tsbench.core.provenance import closure, digest, versions
from tsbench.dataset.placements.base import Placement

_MAKER = "tsbench.dataset.scenes.map_scenarios"
# It imports every placement, of which a type uses one.
_LEFT_OUT = ("tsbench/dataset/placements/registry.py",)


def maker_fingerprint(placement: Placement) -> str:
    """SHA-256 over all that decides what a placement's scenes look like: the code of other placements does not."""
    return _fingerprint(Path(inspect.getfile(type(placement))))


@cache
def _fingerprint(placement: Path) -> str:
    return digest({"code": closure([_MAKER, placement], _LEFT_OUT), "versions": versions()})
