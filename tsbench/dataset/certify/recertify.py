"""Certificates renewed: each row driven again in another process than the one that certified it. Resumable.

Every map's rows leave a JSON below `scenarios/build/certify/`, keyed by rows, old certificates and code; what was
driven is not driven again.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.dataset.certify.certifier import Certifier
from tsbench.dataset.certify.fingerprint import driving_fingerprint
from tsbench.scenarios.certificates import (
    Certificate,
    certificates_path,
    read_certificates,
    write_certificates,
)
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneStore
from tsbench.sim.sumo import Simulation

Problem = tuple[str, str]
_Batch = list[tuple[ScenarioSpec, Certificate]]
_AT_ONCE = 64


@lru_cache(maxsize=1)
def _prover(root: Path) -> Certifier:
    return Certifier(Simulation(), SceneLoader(SceneStore(root)))


def _drive(batch: _Batch, root: Path) -> list[Certificate]:
    prover = _prover(root)
    return [prover.again(spec, old) for spec, old in batch]


def recertify(
    rows: Sequence[ScenarioSpec], root: Path, workers: int, progress: Callable[[int], None]
) -> list[Problem]:
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
        batches[(row.scenario_type, row.map_id)].append((row, table[row.scenario_id]))
    problems: list[Problem] = []
    done = 0
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for batch, renewed in _driven(list(batches.values()), root, pool):
            for (_, old), new in zip(batch, renewed, strict=True):
                table[new.scenario_id] = new
                problems += [(new.scenario_id, p) for p in _problems(old, new)]
            done += len(batch)
            progress(done)
    write_certificates(table.values(), path)
    return problems


def draw_sample(rows: Sequence[ScenarioSpec], size: int) -> list[ScenarioSpec]:
    """`size` rows of each type by a fixed lot: if other code is at work, do its episodes still come out the same?"""
    by_type: dict[str, list[ScenarioSpec]] = defaultdict(list)
    for row in sorted(rows, key=lambda r: hashlib.sha256(f"sample {r.scenario_id}".encode()).digest()):
        by_type[row.scenario_type].append(row)
    return [row for _, drawn in sorted(by_type.items()) for row in drawn[:size]]


def _driven(
    batches: list[_Batch], root: Path, pool: ProcessPoolExecutor
) -> Iterator[tuple[_Batch, list[Certificate]]]:
    """Batches with their renewed certificates, in order; a few dozen under way at once."""
    queue = iter(batches)
    while window := list(islice(queue, _AT_ONCE)):
        running = [(batch, _start(batch, root, pool)) for batch in window]
        yield from ((batch, get()) for batch, get in running)


def _start(batch: _Batch, root: Path, pool: ProcessPoolExecutor) -> Callable[[], list[Certificate]]:
    row = batch[0][0]
    path = root / "build" / "certify" / row.scenario_type / f"{row.map_id}.json"
    text = json.dumps(
        [[asdict(spec), asdict(replace(old, reproduced=None))] for spec, old in batch], sort_keys=True
    )
    stamp = hashlib.sha256(f"{driving_fingerprint()}|{text}".encode()).hexdigest()
    if path.is_file():
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["stamp"] == stamp:
            return lambda: [Certificate(**c) for c in kept["certificates"]]
    future = pool.submit(_drive, batch, root)

    def get() -> list[Certificate]:
        renewed = future.result()
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(
            json.dumps({"stamp": stamp, "certificates": [asdict(c) for c in renewed]}), encoding="utf-8"
        )
        part.replace(path)
        return renewed

    return get


def _problems(old: Certificate, new: Certificate) -> list[str]:
    """What is wrong with a renewed certificate. An untempting row is none: shares of them are bounded per type."""
    found = []
    if not new.solvable:
        found.append("no expert solves it" + (f" (before: {old.expert})" if old.expert else ""))
    if not new.sane:
        found.append(new.error or f"not sane: {new.overlaps} overlaps, {new.road_users} road users")
    if not new.reproduced:
        found.append(
            f"it comes out differently than when it was certified: {'; '.join(old.differences(new))}"
        )
    return found
