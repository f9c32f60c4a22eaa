"""From OSM extracts to the pool: find, drop what a better extract has, lint, write. Resumable."""

from __future__ import annotations

import math
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from tsbench.core.errors import InputError, TsbenchError
from tsbench.dataset.maps.crop import plain_crop
from tsbench.dataset.maps.extracts import by_preference
from tsbench.dataset.maps.families.expectations import expectations
from tsbench.dataset.maps.families.registry import REGISTRY
from tsbench.dataset.maps.harvest_store import batch_name, harvest_dir, harvest_key, read_json, write_json
from tsbench.dataset.maps.lint import lint_crops
from tsbench.dataset.maps.osm import extract_name, sha256_of
from tsbench.dataset.maps.overlap import Coverage
from tsbench.dataset.maps.source import SourceNetwork, list_extracts, load_source
from tsbench.scenarios.map_pool import PoolRow, read_pool, write_pool

BATCH = 250
SAME_RING_M = 80.0
Progress = Callable[[str, int, int], None]  # what is done, steps done, steps in all


@dataclass(frozen=True)
class HarvestResult:
    """The pool's rows and what was refused: counts by source and reason."""

    rows: list[PoolRow]
    rejected: dict[str, dict[str, int]]

    @property
    def refused(self) -> dict[str, int]:
        """What was refused, summed over the sources, by reason."""
        total: Counter[str] = Counter()
        for counts in self.rejected.values():
            total.update(counts)
        return dict(sorted(total.items()))

    @property
    def rings(self) -> int:
        """How many different roundabouts the roundabout maps are of."""
        return len({(row.source, *row.fields["ring"]) for row in self.rows if row.family == "roundabout"})


@dataclass(frozen=True)
class _Batch:
    folder: Path
    source: str
    family: str
    osm_dir: Path
    rows: tuple[PoolRow, ...]

    @property
    def file(self) -> Path:
        return self.folder / batch_name(self.source, self.family, self.rows)


def harvest(osm_dir: Path, out: Path, report: Path, workers: int, progress: Progress) -> HarvestResult:
    """Harvest all extracts of a folder into the pool index `out`, and the counts into `report` (JSON)."""
    extracts = {extract_name(path): path for path in list_extracts(osm_dir)}
    names = by_preference(sorted(extracts))
    folder = harvest_dir(harvest_key([extracts[name] for name in names]))
    folder.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        # the biggest extract is the last in the order of preference: begin with it
        convert = [pool.submit(_convert, name, osm_dir) for name in reversed(names)]
        _wait(convert, "converting", progress)
        find = [pool.submit(_find, folder, name, names[:rank], osm_dir) for rank, name in enumerate(names)]
        _wait(find[::-1], "finding maps", progress)
        batches = [batch for name in names for batch in _batches(folder, name, osm_dir)]
        _wait(
            [pool.submit(_lint, batch) for batch in batches if not batch.file.is_file()], "linting", progress
        )
    result = _collect(folder, names, batches)
    if not result.rows:
        raise InputError(f"{osm_dir}: no map found in {len(names)} extracts; see the reasons in {report}")
    write_pool(result.rows, out)
    write_json(report, _summary(result, extracts))
    return result


def _wait(jobs: Sequence[Future[None]], what: str, progress: Progress) -> None:
    """Wait for all; the first error ends the harvest (what is finished stays on disk)."""
    progress(what, 0, len(jobs))
    try:
        for done, job in enumerate(as_completed(jobs), start=1):
            job.result()
            progress(what, done, len(jobs))
    except BrokenProcessPool as died:
        raise TsbenchError(f"a worker died while {what}; run the harvest again, it goes on there") from died
    except BaseException:
        for job in jobs:
            job.cancel()
        raise


@lru_cache(maxsize=8)
def _source(name: str, osm_dir: Path) -> SourceNetwork:
    """Networks stay in the worker from batch to batch."""
    return load_source(name, osm_dir)


def _convert(name: str, osm_dir: Path) -> None:
    load_source(name, osm_dir)


def _find(folder: Path, name: str, better: list[str], osm_dir: Path) -> None:
    """Find an extract's maps of all families that no better extract has."""
    found, counts = folder / f"found-{name}.parquet", folder / f"found-{name}.json"
    if counts.is_file():
        return
    source = _source(name, osm_dir)
    coverage = Coverage([_source(other, osm_dir) for other in better])
    rejected: Counter[str] = Counter()
    rows = []
    for family, methods in REGISTRY.items():
        for row in methods.find(source, rejected):
            # rings are compared at the end, as maps: one that is unsound there may be sound here
            if family != "roundabout" and coverage.holds(source, methods.pieces(source, row.fields)):
                rejected[f"{family.replace('_', ' ')}: a better-tagged extract has the place"] += 1
            else:
                rows.append(row)
    write_pool(rows, found)
    write_json(counts, dict(rejected))


def _batches(folder: Path, name: str, osm_dir: Path) -> Iterator[_Batch]:
    rows = read_pool(folder / f"found-{name}.parquet")
    for family in REGISTRY:
        members = [row for row in rows if row.family == family]
        for start in range(0, len(members), BATCH):
            yield _Batch(folder, name, family, osm_dir, tuple(members[start : start + BATCH]))


def _lint(batch: _Batch) -> None:
    source = _source(batch.source, batch.osm_dir)
    write_json(batch.file, lint_crops([(plain_crop(row, source), expectations(row)) for row in batch.rows]))


def _collect(folder: Path, names: list[str], batches: Sequence[_Batch]) -> HarvestResult:
    """The sound rows, one per map id, and all counts."""
    rejected = {name: Counter(read_json(folder / f"found-{name}.json")) for name in names}
    sound: dict[str, PoolRow] = {}
    faults: dict[str, tuple[str, str]] = {}
    for batch in batches:
        for row, fault in zip(batch.rows, read_json(batch.file), strict=True):
            if fault:
                faults[row.map_id] = (row.source, f"{row.family.replace('_', ' ')}: {fault}")
            else:
                # a roundabout comes with its arms cut in several ways, the preferred one first
                sound.setdefault(row.map_id, row)
    twice = _rings_seen_before(list(sound.values()), names)
    for name, source in twice.items():
        rejected[source]["roundabout: a better-tagged extract has the place"] += 1
        del sound[name]
    for name, (source, reason) in faults.items():
        if name not in sound and name not in twice:
            rejected[source][reason] += 1
    return HarvestResult(
        sorted(sound.values(), key=lambda row: row.map_id),
        {name: dict(sorted(counts.items())) for name, counts in rejected.items()},
    )


def _rings_seen_before(rows: Sequence[PoolRow], names: list[str]) -> dict[str, str]:
    """Map id and source of the roundabouts within 80 m of one from a better extract."""
    rings = [row for row in rows if row.family == "roundabout"]
    rank = {name: index for index, name in enumerate(names)}
    return {
        row.map_id: row.source
        for row in rings
        if any(
            rank[other.source] < rank[row.source]
            and math.hypot(other.east - row.east, other.north - row.north) < SAME_RING_M
            for other in rings
        )
    }


def _summary(result: HarvestResult, extracts: dict[str, Path]) -> dict[str, object]:
    kinds = Counter(f"{row.family}/{row.shape}" for row in result.rows)
    return {
        "schema": 1,
        "extracts_sha256": {name: sha256_of(path) for name, path in extracts.items()},
        "maps": len(result.rows),
        "kinds": dict(kinds),
        "by_source": dict(Counter(f"{row.source}/{row.family}" for row in result.rows)),
        "rings": result.rings,
        "rejected": result.rejected,
    }
