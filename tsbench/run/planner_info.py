"""What a run writes down about a planner: who it is, and the hashes of its code and weights.

The code is the file that a planner is written in with all that it imports from beside it, from the path or from
tsbench, as far as that is not in the contract, and the data files (weights, settings) that its code names.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.provenance import closure, digest
from tsbench.planners.common.batching import DEVICES, is_served
from tsbench.planners.loading import cause_with_place
from tsbench.planners.registry import LoadedPlanner, entry, resolve
from tsbench.run.contract import code_files


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
    """Of the planner's file and all that it imports, with the data files that they name; the contract has the rest."""
    return None if source is None else digest(closure([source], code_files()))


def _source(loaded: LoadedPlanner) -> Path | None:
    """The file of the module that the planner is named in, None for what has none (built into Python)."""
    target = loaded.spec if ":" in loaded.spec else entry(loaded.spec).target
    place = target.rpartition(":")[0]
    if place.endswith(".py"):
        return Path(place)
    found = importlib.util.find_spec(place)
    return Path(found.origin) if found and found.origin and Path(found.origin).is_file() else None
