"""What a run writes down about a planner: who it is, and the hashes of its code and weights."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
from pathlib import Path
from typing import Any

from tsbench.planners.registry import LoadedPlanner, resolve


def describe(spec: str) -> dict[str, Any]:
    """Name, spec, privileged, sign_access, weights_sha256 and code_sha256 (None where there is none).

    Raises:
        InputError: there is no such planner, or it does not import.
    """
    loaded = resolve(spec)
    source = _source(loaded)
    return {
        "name": loaded.name,
        "spec": loaded.spec,
        "privileged": loaded.privileged,
        "sign_access": loaded.sign_access,
        "weights_sha256": None if loaded.weights is None else loaded.weights.sha256,
        "code_sha256": None if source is None else hashlib.sha256(source.read_bytes()).hexdigest(),
    }


def _source(loaded: LoadedPlanner) -> Path | None:
    """The file that the planner is written in, None for what has no source (an extension module)."""
    place, colon, _ = loaded.spec.rpartition(":")
    if colon and place.endswith(".py"):
        return Path(place)
    if colon:
        found = importlib.util.find_spec(place)
        name = None if found is None else found.origin
    else:
        name = inspect.getsourcefile(loaded.factory)
    return Path(name) if name and name.endswith(".py") and Path(name).is_file() else None
