"""Learned parameters: where they are, what is known of them, and the check of their hash before each use.

Of each network `NAME` stand two files: `NAME.safetensors`, and `NAME.json` with size, SHA-256, number of parameters,
origin, and the training that made it. Both lie in `tsbench/planners/weights/`; a file that is too large for the package
is fetched from its origin into the platform's cache directory, once. `tsbench train` writes the same pair.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import platformdirs

from tsbench.core.errors import InputError
from tsbench.data.fetch import fetch_file
from tsbench.planners.registry import PlannerEntry, Weights

Tensors = dict[str, npt.NDArray[Any]]

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
    name: str, target: str, *, kind: str = "learned", privileged: bool = False, sign_access: bool = False
) -> PlannerEntry:
    """The registry's entry of a planner that uses network `name`; size, hash and parameters as its file says."""
    facts = network(name)
    return PlannerEntry(target, kind, privileged, sign_access, facts.parameters, facts.weights)


def load_weights(name: str, folder: Path | None = None) -> Tensors:
    """All tensors of a network by name, as NumPy arrays; InputError unless the file has the size and hash it should."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    facts = network(name, folder)
    path = _place(facts.weights, folder)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): {_remedy(folder)}") from None
    _check(content, facts.weights, path, folder)
    try:
        tensors: Tensors = load(content)
    except SafetensorError as error:
        raise InputError(f"{path}: is no safetensors file ({error})") from None
    return tensors


def save_weights(name: str, folder: Path, tensors: Tensors, training: Mapping[str, Any]) -> Network:
    """Write `NAME.safetensors` and `NAME.json` below `folder`; counts every element as a parameter."""
    from safetensors.numpy import save

    folder.mkdir(parents=True, exist_ok=True)
    content = save({key: np.ascontiguousarray(tensors[key]) for key in sorted(tensors)})
    weights = Weights(f"{name}.safetensors", len(content), hashlib.sha256(content).hexdigest(), PACKAGED)
    facts = Network(name, weights, sum(int(t.size) for t in tensors.values()), training)
    text = json.dumps(
        {
            "schema_version": SCHEMA_VERSION,
            "file": weights.file,
            "size": weights.size,
            "sha256": weights.sha256,
            "source": weights.source,
            "parameters": facts.parameters,
            "training": dict(training),
        },
        indent=1,
    )
    _write(folder / weights.file, content)
    _write(folder / f"{name}.json", text.encode() + b"\n")
    return facts


def _place(weights: Weights, folder: Path | None) -> Path:
    """Where the file is; fetched first where it is of another place and not in the cache."""
    beside = (folder or _FOLDER) / weights.file
    if beside.is_file() or weights.source == PACKAGED:
        return beside
    cached = Path(platformdirs.user_cache_dir("tsbench")) / "weights" / weights.file
    if not cached.is_file():
        fetch_file(weights.source, weights.size, weights.sha256, cached)
    return cached


def _check(content: bytes, weights: Weights, path: Path, folder: Path | None) -> None:
    if len(content) != weights.size or hashlib.sha256(content).hexdigest() != weights.sha256:
        raise InputError(
            f"{path}: is damaged: {len(content)} bytes, and not the SHA-256 {weights.sha256[:12]} of {weights.size} "
            f"bytes that it should have: {_remedy(folder, path)}"
        )


def _remedy(folder: Path | None, path: Path | None = None) -> str:
    if path is not None and folder is None and path.parent != _FOLDER:
        return "delete it, and it is fetched again"
    return "reinstall tsbench" if folder is None else "export it again (tsbench train)"


def _write(path: Path, content: bytes) -> None:
    """All or nothing: a broken-off write leaves no half file under its name."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}")
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    Path(temporary).chmod(0o644)
    Path(temporary).replace(path)
