"""The contract hash: the fingerprint of everything that must be equal for two scores to be comparable."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

import tsbench
from tsbench.core.paths import mirrored_in_use, source_city, using_city
from tsbench.core.provenance import Files, closure, data_hash, digest, versions
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.signs.catalog import Catalog, load_catalog

# From a row to its record: the worker and what it is told to run by name, and the pool, whose limits are outcomes.
ROOTS = (
    "tsbench/run/execution/worker_main.py",
    "tsbench/episode/runner.py",
    "tsbench/run/log/score.py",
    "tsbench/run/execution/local.py",
)
# Planners are in nobody's way here: `planners.registry` finds them by name, and what they consist of stands in their
# own hashes (`run.planner_info`). Who carries rows to other machines (`run.execution.ray`) runs the same pools there.


def contract_hash(rows: Sequence[ScenarioSpec], catalog: Catalog, code: str | None = None) -> str:
    """SHA-256 (hex) over the code from a row to its record, the rows, their signs with rules, and versions.

    code: the hash of the code, None: that of this tsbench.
    Rows hold the hashes of their scene files. The arithmetic of a processor is no part of it: `run.json` records it.
    That of a mirrored data set follows from that of the one it mirrors.
    """
    if mirrored_in_use():
        with using_city(source_city()):
            stored = [mirrored_row(row) for row in rows]
            return mirrored_contract(contract_hash(stored, load_catalog(catalog.root), code))
    contrast = any(row.half == CONTRAST for row in rows)
    rules = catalog.contract_entries((row.sign_code for row in rows), contrast)
    data = data_hash(rows, rules)
    return digest({"code": code or code_hash(), "data": data, "versions": versions()})


def mirrored_contract(contract: str) -> str:
    """The contract of a data set's mirror image, by its own."""
    return digest({"mirrored": contract})


@cache
def _own_files() -> Files:
    return code_files()


def code_hash() -> str:
    return digest(_own_files())


def code_changed() -> bool:
    """Do the contract's files say something else than when this process first read them?"""
    return code_files() != _own_files()


_from_run: list[str] = []


@cache
def file_names() -> frozenset[str]:
    """Names of the contract's files, as in `code_files`. A worker has them of its run: see `use_file_names`."""
    return frozenset(_from_run or _own_files())


def use_file_names(names: Iterable[str]) -> None:
    """Let `file_names` be these, which the run of this worker process has found: finding them takes 0.3 s."""
    file_names.cache_clear()
    _from_run[:] = names


def code_files(place: Path = Path(tsbench.__file__).parent.parent) -> Files:
    """The files of the contract, from the tsbench below `place`."""
    return closure([place / name for name in ROOTS])
