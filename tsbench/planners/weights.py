"""Learned parameters: where they are, what is known of them, and the check of their hash before each use.

Of each network `NAME` stand two files: `NAME.safetensors`, and `NAME.json` with size, SHA-256, number of parameters,
origin, and the training that made it. Both lie in `tsbench/planners/weights/`; a file that is too large for the package
is fetched from its origin into the platform's cache directory, once. `tsbench train` writes the same pair.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import platformdirs

from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic, write_json
from tsbench.planners.registry import PlannerEntry, Weights

Tensors = dict[str, npt.NDArray[Any]]
T = TypeVar("T")

SCHEMA_VERSION = 1
PACKAGED = "package"
_FOLDER = Path(__file__).with_name("weights")


@dataclass(frozen=True)
class Network:
    """What `NAME.json` says. parameters: learned ones. training: command, seed, steps, duration and the like."""

    name: str
    weights: Weights
    parameters: int
    training: Mapping[str, Any]


def network(name: str, folder: Path | None = None) -> Network:
    """The facts of a network below `folder` (None: tsbench's own). Raises InputError for a missing or foreign file."""
    path = (folder or _FOLDER) / f"{name}.json"
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        if facts["schema_version"] != SCHEMA_VERSION:
            raise InputError(f"{path}: schema version {facts['schema_version']}, expected {SCHEMA_VERSION}")
        weights = Weights(str(facts["file"]), int(facts["size"]), str(facts["sha256"]), str(facts["source"]))
        return Network(name, weights, int(facts["parameters"]), facts["training"])
    except FileNotFoundError:
        raise InputError(f"{path}: no such file: {_remedy(folder)}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: does not describe weights ({type(error).__name__}: {error})") from None


def learned(
    name: str, target: str, *, sign_access: bool = False, chooses_route: bool = False, floor: bool = False
) -> PlannerEntry:
    """The registry's entry of a planner that uses network `name`; size, hash and parameters as its file says."""
    facts = network(name)
    return PlannerEntry(target, "learned", False, sign_access, chooses_route, facts.parameters, facts.weights, floor)


def load_weights(name: str, folder: Path | None = None) -> Tensors:
    """All tensors of a network by name, as NumPy arrays; InputError unless the file has the size and hash it should."""
    import safetensors.numpy

    path, content = _content(name, folder)
    try:
        tensors: Tensors = safetensors.numpy.load(content)
    except safetensors.SafetensorError as error:
        raise InputError(f"{path}: is no safetensors file ({error})") from None
    return tensors


def load_metadata(name: str, folder: Path | None = None) -> Mapping[str, str]:
    """What stands in the head of a network's file beside the tensors; checked as by `load_weights`."""
    _, content = _content(name, folder)
    # The head is JSON, behind its length in eight bytes.
    head = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    metadata: Mapping[str, str] = head.get("__metadata__", {})
    return metadata


def fitted(name: str, folder: Path | None, make: Callable[[Tensors], T]) -> T:
    """What `make` makes of a network's tensors; its KeyError, ValueError or RuntimeError become an InputError."""
    tensors = load_weights(name, folder)
    try:
        return make(tensors)
    except (KeyError, ValueError, RuntimeError) as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(f"weights {name!r}: are not those of {name}'s network ({problem})") from None


def save_weights(
    name: str, folder: Path, tensors: Tensors, training: Mapping[str, Any], metadata: Mapping[str, str] | None = None
) -> Network:
    """Write `NAME.safetensors` and `NAME.json` below `folder`; counts every element as a parameter.

    metadata: of the file's head. With one key at most the same tensors are the same bytes.
    """
    from safetensors.numpy import save

    content = save({key: np.ascontiguousarray(tensors[key]) for key in sorted(tensors)}, metadata)
    weights = Weights(f"{name}.safetensors", len(content), hashlib.sha256(content).hexdigest(), PACKAGED)
    facts = Network(name, weights, sum(int(t.size) for t in tensors.values()), training)
    write_atomic(folder / weights.file, content)
    told = {"schema_version": SCHEMA_VERSION, **asdict(weights), "parameters": facts.parameters}
    write_json(folder / f"{name}.json", {**told, "training": dict(training)})
    return facts


def _content(name: str, folder: Path | None) -> tuple[Path, bytes]:
    """A network's file and what is in it, checked."""
    facts = network(name, folder)
    path = file_of(facts.weights, folder)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): {_remedy(folder)}") from None
    size, sha256 = facts.weights.size, facts.weights.sha256
    if len(content) != size or hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            f"{path}: is damaged: {len(content)} bytes, and not the SHA-256 {sha256[:12]} of {size} bytes that it "
            f"should have: {_remedy(folder, path)}"
        )
    return path, content


def file_of(weights: Weights, folder: Path | None = None) -> Path:
    """Where the file of a network below `folder` (None: tsbench's own) is; fetched where it is not in the cache yet."""
    beside = (folder or _FOLDER) / weights.file
    if beside.is_file() or weights.source == PACKAGED:
        return beside
    cached = Path(platformdirs.user_cache_dir("tsbench")) / "weights" / weights.file
    if not cached.is_file():
        # It imports what speaks HTTP, which most processes do without.
        from tsbench.core.fetch import fetch_file

        fetch_file(weights.source, weights.size, weights.sha256, cached)
    return cached


def _remedy(folder: Path | None, path: Path | None = None) -> str:
    if path is not None and folder is None and path.parent != _FOLDER:
        return "delete it, and it is fetched again"
    return "reinstall tsbench" if folder is None else "export it again (tsbench train)"
