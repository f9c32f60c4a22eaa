"""From OSM extracts to the pool: find, drop what a better extract has, lint, write. Resumable."""

from __future__ import annotations

import hashlib
import inspect
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of, write_json
from tsbench.core.parallel import CachedResult, worker_processes
from tsbench.core.paths import cities_folder
from tsbench.make.city import build_dir, by_preference, list_extracts, load_city, netconvert_file, types_file
from tsbench.make.maps.crop import REGISTRY, lint_crops, plain_crop
from tsbench.make.maps.extracts import extract_name
from tsbench.make.maps.pieces import EdgePiece, densified, piece_line
from tsbench.make.maps.source import SourceNetwork, kept_source, load_source
from tsbench.make.maps.utm import UtmFrame
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import PoolRow, read_pool, write_pool

BATCH = 250
SAME_RING_M = 80.0
Progress = Callable[[str, int, int], None]  # what is done, steps done, steps in all
Keep = Callable[..., CachedResult] | None
STEP_M = 10.0
NEAR_M = 30.0  # generalised shapes are off by up to 28 m
MAX_SHARE = 0.25


@dataclass(frozen=True)
class HarvestResult:
    """The pool's rows and what was refused: counts by source and reason.

    notes: what of the extracts was not taken as it is, a line each.
    """

    rows: list[PoolRow]
    rejected: dict[str, dict[str, int]]
    notes: tuple[str, ...] = ()

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
    data: DataSet
    folder: Path
    source: str
    family: str
    osm_dir: Path
    rows: tuple[PoolRow, ...]

    @property
    def kept(self) -> CachedResult:
        """Where its faults stay, by what is linted."""
        text = "\n".join(row.map_id + row.detail for row in self.rows)
        stamp = hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
        return CachedResult(self.folder / f"lint-{self.source}-{self.family}-{stamp}.json", stamp)


def harvest(data: DataSet, osm_dir: Path, out: Path, report: Path, workers: int, progress: Progress) -> HarvestResult:
    """Harvest all extracts of a folder into the pool index `out`, and the counts into `report` (JSON)."""
    extracts = {extract_name(path): path for path in list_extracts(data, osm_dir)}
    names = by_preference(data, sorted(extracts))
    folder = build_dir() / "harvest" / _key(data, [extracts[name] for name in names])
    with worker_processes(workers, "harvesting") as pool:

        def each(what: str, work: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], keep: Keep) -> list[Any]:
            results = []
            progress(what, 0, len(jobs))
            for result in pool.ordered(work, jobs, keep):
                results.append(result)
                progress(what, len(results), len(jobs))
            return results

        # the biggest extract is the last in the order of preference: begin with it
        ranked = [(data, folder, name, names[:rank], osm_dir) for rank, name in enumerate(names)][::-1]
        read = each("converting", _convert, [(data, name, osm_dir) for _, _, name, _, _ in ranked], None)
        frames = {name: frame for (_, _, name, _, _), (frame, _) in zip(ranked, read, strict=True)}
        _check_one_frame(data, frames, osm_dir)
        counts = each(
            "finding maps", _find, ranked, lambda _, __, name, *___: CachedResult(folder / f"found-{name}.json", "")
        )
        batches = [batch for name in names for batch in _batches(data, folder, name, osm_dir)]
        faults = each("linting", _lint, [(batch,) for batch in batches], lambda batch: batch.kept)
    rejected = {name: Counter(found) for (_, _, name, _, _), found in zip(ranked, counts, strict=True)}
    result = _collect({name: rejected[name] for name in names}, batches, faults)
    if not result.rows:
        raise InputError(f"{osm_dir}: no map found in {len(names)} extracts; see the reasons in {report}")
    write_pool(result.rows, out)
    write_json(report, _summary(result, extracts), indent=1, sort_keys=True)
    notes = {name: told for (_, _, name, _, _), (_, told) in zip(ranked, read, strict=True)}
    return replace(result, notes=tuple(f"{extracts[name]}: {one}" for name in names for one in notes[name]))


def _key(data: DataSet, extracts: Sequence[Path]) -> str:
    """A digest of extracts, configurations and this package's code: other inputs, another folder."""
    inputs = [*extracts, cities_folder() / f"{data.city}.yaml", types_file(data)]
    inputs += [netconvert_file(name) for name in ("extract.netccfg", "crop.netccfg")]
    inputs += [Path(inspect.getfile(load_city)), *sorted(Path(__file__).parent.glob("*.py"))]
    digest = hashlib.blake2b(digest_size=8)
    for path in inputs:
        digest.update(f"{path.name} {sha256_of(path)}\n".encode())
    return digest.hexdigest()


def _convert(data: DataSet, name: str, osm_dir: Path) -> tuple[UtmFrame, list[str]]:
    source = load_source(data, name, osm_dir)
    return source.frame, source.notes


def _check_one_frame(data: DataSet, frames: dict[str, UtmFrame], osm_dir: Path) -> None:
    """Places are compared in metres, so all extracts of a pool are in the frame of their city."""
    city = load_city(data.name)
    other = next((name for name, found in frames.items() if found != city.frame), None)
    if other is not None:
        remedy = (
            f"write `zone: {frames[other].zone}` into cities/{city.name}.yaml"
            if len(set(frames.values())) == 1
            else "describe another one in cities/ and name it with --city"
        )
        raise InputError(
            f"{osm_dir}: {other} is in {frames[other]}, {city.name} in {city.frame}: one pool is of one city; {remedy}"
        )


def _find(data: DataSet, folder: Path, name: str, better: list[str], osm_dir: Path) -> dict[str, int]:
    """Write an extract's maps of all families that no better extract has; what was refused is counted by reason."""
    source = kept_source(data, name, osm_dir)
    coverage = Coverage([kept_source(data, other, osm_dir) for other in better])
    rejected: Counter[str] = Counter()
    rows = []
    for family, methods in REGISTRY.items():
        for row in methods.find(source, rejected):
            # rings are compared at the end, as maps: one that is unsound there may be sound here
            if family != "roundabout" and coverage.holds(source, methods.pieces(source, row.fields)):
                rejected[f"{family.replace('_', ' ')}: a better-tagged extract has the place"] += 1
            else:
                rows.append(row)
    write_pool(rows, _found(folder, name))
    return dict(rejected)


def _found(folder: Path, name: str) -> Path:
    return folder / f"found-{name}.parquet"


def _batches(data: DataSet, folder: Path, name: str, osm_dir: Path) -> Iterator[_Batch]:
    rows = read_pool(_found(folder, name))
    for family in REGISTRY:
        members = [row for row in rows if row.family == family]
        for start in range(0, len(members), BATCH):
            yield _Batch(data, folder, name, family, osm_dir, tuple(members[start : start + BATCH]))


def _lint(batch: _Batch) -> list[str]:
    source = kept_source(batch.data, batch.source, batch.osm_dir)
    return lint_crops([(plain_crop(row, source), REGISTRY[row.family].expect(row)) for row in batch.rows])


def _collect(rejected: dict[str, Counter[str]], batches: Sequence[_Batch], found: Sequence[list[str]]) -> HarvestResult:
    """The sound rows, one per map id, and all counts. rejected: by source, the better-tagged first; found: faults."""
    sound: dict[str, PoolRow] = {}
    faults: dict[str, tuple[str, str]] = {}
    for batch, told in zip(batches, found, strict=True):
        for row, fault in zip(batch.rows, told, strict=True):
            if fault:
                faults[row.map_id] = (row.source, f"{row.family.replace('_', ' ')}: {fault}")
            else:
                # a roundabout comes with its arms cut in several ways, the preferred one first
                sound.setdefault(row.map_id, row)
    twice = _rings_seen_before(list(sound.values()), list(rejected))
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


class Coverage:
    """The roads of better-tagged extracts, as points every 10 m."""

    def __init__(self, better: Sequence[SourceNetwork]) -> None:
        points = [densified(source.line(row), STEP_M) for source in better for row in range(len(source.edge_ids))]
        self._tree = cKDTree(np.concatenate(points)) if points else None

    def holds(self, source: SourceNetwork, pieces: Sequence[EdgePiece]) -> bool:
        """Whether a better extract has the place: a quarter of the crop lies within 30 m of its roads."""
        if self._tree is None:
            return False
        points = np.concatenate([densified(piece_line(source, piece), STEP_M) for piece in pieces])
        distance, _ = self._tree.query(points, distance_upper_bound=NEAR_M)
        return bool(np.isfinite(distance).mean() > MAX_SHARE)
