"""The contract hash: the fingerprint of everything that must be equal for two scores to be comparable."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path

import tsbench
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import Catalog

# What decides what happens in an episode and how it is judged; not what is made of the records afterwards.
CODE = (
    "geometry",
    "metrics/comfort.py",
    "metrics/episode.py",
    "metrics/fault.py",
    "metrics/flags.py",
    "metrics/interaction.py",
    "metrics/outcome.py",
    "metrics/progress.py",
    "metrics/tracks.py",
    "roads",
    "rules",
    "sim",
    "maps/network.py",
    "run/command.py",
    "run/episode.py",
    "run/observe.py",
)


def contract_hash(rows: Sequence[ScenarioSpec], catalog: Catalog) -> str:
    """SHA-256 (hex) over rules, thresholds, the split's rows with file hashes, code, SUMO version."""
    parts = {
        "catalog": catalog.fingerprint(),
        "code": code_hash(),
        "scenarios": rows_hash(rows),
        "sumo": version("libsumo"),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def rows_hash(rows: Sequence[ScenarioSpec]) -> str:
    """SHA-256 (hex) over all fields of all rows, whatever their order."""
    digest = hashlib.sha256()
    for row in sorted(rows, key=lambda row: row.scenario_id):
        digest.update(json.dumps(asdict(row), sort_keys=True).encode() + b"\n")
    return digest.hexdigest()


@cache
def code_hash() -> str:
    """SHA-256 (hex) over the sources named by CODE, by path."""
    root = Path(tsbench.__file__).parent
    digest = hashlib.sha256()
    for part in CODE:
        there = root / part
        files = [there] if there.is_file() else there.rglob("*.py")
        for path in sorted(files, key=lambda p: p.relative_to(root).as_posix()):
            content = path.read_bytes()
            digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()
