"""Certificates renewed: each row driven again in another process than the one that certified it. Resumable."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.parallel import CachedResult, worker_processes
from tsbench.make.certify.certifier import Certifier
from tsbench.run.edition import code_hash
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates, write_certificates
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneStore
from tsbench.sim.sumo import Simulation

Problem = tuple[str, str]
_Batch = list[tuple[ScenarioSpec, Certificate]]


@lru_cache(maxsize=1)
def _certifier(root: Path) -> Certifier:
    return Certifier(Simulation(), SceneLoader(DataSet(), SceneStore(root)))


def _drive(batch: _Batch, root: Path) -> list[dict[str, Any]]:
    """The rows of a map, in order, so that the halves of a pair stand side by side."""
    certifier = _certifier(root)
    pairs = groupby(batch, key=lambda proven: proven[0].pair_name)
    return [asdict(new) for _, pair in pairs for new in certifier.again(list(pair))]


def _kept(batch: _Batch, root: Path) -> CachedResult:
    """Where a map's certificates stay while a run goes on: keyed by rows, old certificates and code."""
    row = batch[0][0]
    text = json.dumps([[asdict(spec), asdict(replace(old, reproduced=None))] for spec, old in batch], sort_keys=True)
    stamp = hashlib.sha256(f"{code_hash()}|{text}".encode()).hexdigest()
    return CachedResult(root / "build" / "certify" / row.pair_type / f"{row.map_id}.json", stamp)


def recertify(rows: Sequence[ScenarioSpec], root: Path, workers: int, progress: Callable[[int], None]) -> list[Problem]:
    """Renew the certificates of `rows` in the table below `root`; returns (scenario id, problem) of those that fail.

    Raises InputError for a row without a certificate: only the builder measures its traffic.
    """
    path = certificates_path(root)
    table = {c.scenario_id: c for c in read_certificates(path)}
    missing = [r.scenario_id for r in rows if r.scenario_id not in table]
    if missing:
        raise InputError(f"{path}: no certificate for {missing[0]} (tsbench scenarios build makes it)")
    batches: dict[tuple[str, str], _Batch] = defaultdict(list)
    for row in sorted(rows, key=lambda r: r.scenario_id):
        batches[(row.pair_type, row.map_id)].append((row, table[row.scenario_id]))
    problems: list[Problem] = []
    done = 0
    with worker_processes(workers, "certifying") as pool:
        driven = pool.ordered(_drive, ((batch, root) for batch in batches.values()), _kept)
        for batch, renewed in zip(batches.values(), driven, strict=True):
            for (_, old), fields in zip(batch, renewed, strict=True):
                new = Certificate(**fields)
                table[new.scenario_id] = new
                problems += [(new.scenario_id, p) for p in _problems(old, new)]
            done += len(batch)
            progress(done)
    write_certificates(table.values(), path)
    return problems


def draw_sample(rows: Sequence[ScenarioSpec], size: int) -> list[ScenarioSpec]:
    """`size` rows or pairs of each type, drawn: if other code is at work, do its episodes still come out the same?"""
    by_type: dict[str, list[str]] = defaultdict(list)
    kinds = {row.pair_name: row.pair_type for row in rows}
    for name in sorted(kinds, key=lambda n: hashlib.sha256(f"sample {n}".encode()).digest()):
        by_type[kinds[name]].append(name)
    drawn = {name for names in by_type.values() for name in names[:size]}
    return [row for row in rows if row.pair_name in drawn]


def _problems(old: Certificate, new: Certificate) -> list[str]:
    """What is wrong with a renewed certificate. Untempting rows are allowed: their share is bounded per type."""
    found = []
    if not new.solvable:
        found.append("no expert solves it" + (f" (before: {old.expert})" if old.expert else ""))
    if not new.sane:
        found.append(new.error or f"not sane: {new.overlaps} overlaps, {new.road_users} road users")
    if not new.reproduced:
        found.append(f"it comes out differently than when it was certified: {'; '.join(old.differences(new))}")
    return found
