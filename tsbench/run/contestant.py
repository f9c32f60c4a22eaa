"""What a run writes down about a planner: who it is, and the hashes of its code and weights.

The code of one of tsbench's own planners is its module and all that it imports from
`tsbench.planners`. Of a planner from elsewhere it is the file that it is written in.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
from pathlib import Path
from typing import Any

import tsbench.planners
from tsbench.errors import InputError
from tsbench.planners.batched import DEVICES, is_served
from tsbench.planners.loading import cause_with_place
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.sources import closure

_OWN = ("tsbench.planners",)


def describe(spec: str) -> dict[str, Any]:
    """Name, spec, privileged, sign_access, served_on, weights_sha256 and code_sha256 (None where there is none).

    Raises:
        InputError: there is no such planner, it does not import, or it cannot be made (a package is missing).
    """
    loaded = resolve(spec)
    _make(loaded)
    return {
        "name": loaded.name,
        "spec": loaded.spec,
        "privileged": loaded.privileged,
        "sign_access": loaded.sign_access,
        "served_on": [device for device in DEVICES if is_served(loaded.factory, device)],
        "weights_sha256": None if loaded.weights is None else loaded.weights.sha256,
        "code_sha256": _code_sha256(_source(loaded)),
    }


def _make(loaded: LoadedPlanner) -> None:
    """Make one, network and all: what is missing is missing in every episode."""
    try:
        loaded.factory()
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise InputError(f"planner {loaded.spec!r}: cannot be made: {cause_with_place(error)}") from error


def _code_sha256(source: Path | None) -> str | None:
    if source is None:
        return None
    own = Path(tsbench.planners.__file__).parent
    if own not in source.parents:
        return hashlib.sha256(source.read_bytes()).hexdigest()
    digest = hashlib.sha256()
    for path in closure([source], _OWN):
        digest.update(path.relative_to(own.parent).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


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
