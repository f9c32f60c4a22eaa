"""Builds the scenario tables: split the pool, then fill each type's quotas map by map, in a fixed order.

Resumable: every map that was tried leaves a JSON beside its scenes' build folder, keyed by what it was made from; a
second build with the same inputs reads it instead of building again. Deterministic: which maps are taken depends on the
order of candidates (tagged extracts first, then a stable hash), never on which worker is done first.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from tsbench.core.benchmark import MAPS, TWO_SIGNS, places_of_split
from tsbench.core.errors import InputError
from tsbench.core.files import write_json
from tsbench.core.parallel import CachedResult, Workers, worker_processes
from tsbench.core.paths import OWN_CITY
from tsbench.core.provenance import closure, digest, versions
from tsbench.make.city import load_city, made_pool
from tsbench.make.maps.ground import write_ground
from tsbench.make.maps.harvest import harvest
from tsbench.make.maps.source import kept_source
from tsbench.make.placements.by_name import placement_of
from tsbench.make.scenes.map_scenarios import MapScenarios, Prover, SiteBuilder
from tsbench.make.scenes.overview import build_report, carried, report_file
from tsbench.make.scenes.recipe import Recipe, load_recipes, stratum_of
from tsbench.make.scenes.split import split_pool, with_places
from tsbench.make.seeds import seed_of
from tsbench.run.edition import editions, release_city
from tsbench.scenarios.certificates import Certificate, certificates_path, read_certificates, write_certificates
from tsbench.scenarios.data_set import SPLITS, DataSet, read_table, write_table
from tsbench.scenarios.map_pool import PoolRow, read_pool
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneFolder, store_path, write_store
from tsbench.sim.sumo import Simulation

APART_M = 60.0
CERTIFIER = "tsbench.make.certify.certifier:Certifier"
AHEAD = 12

Progress = Callable[[str, int, int], None]
# What makes scenes; it imports every placement, though a type uses one. A build writes certificates.
_MAKER = "tsbench.make.scenes.map_scenarios"
_LEFT_OUT = ("tsbench/make/placements/by_name.py", "tsbench/scenarios/certificates.py: scenarios/certificates.parquet")


@dataclass(frozen=True)
class BuildRequest:
    """What to build of a city's data set. types: () = all with a recipe. osm: folder of extracts. root: `scenarios/`.

    certifier: "module:Class" of what drives rows to prove them, "" = nobody; by name, as it stands above this layer and
    is made in each worker process. splits: which tables.
    """

    data: DataSet
    types: tuple[str, ...]
    osm: Path
    root: Path
    workers: int
    certifier: str = CERTIFIER
    splits: tuple[str, ...] = SPLITS

    @property
    def workplace(self) -> Path:
        """Where maps are built, one file each, and what resuming needs stays."""
        return self.root / "build"


@dataclass(frozen=True)
class TypeReport:
    """What became of one type in one split.

    maps, missed: by stratum, taken and wanting. short: maps wanting in all. reasons: of maps that were passed over.
    draws: why draws of variants were not kept, on all maps that were tried, and how often.
    """

    type_id: str
    split: str
    maps: dict[str, int]
    missed: dict[str, int]
    short: int
    reasons: dict[str, int]
    draws: dict[str, int]


@lru_cache(maxsize=1)
def _tools(root: Path, workplace: Path, certifier: str) -> tuple[Simulation, Prover | None]:
    """A worker process's one simulation, and who proves rows in it."""
    sim = Simulation()
    module, _, name = certifier.partition(":")
    loader, before = SceneLoader(DataSet(), SceneFolder(workplace)), certificates_path(root)
    proven = read_certificates(before) if before.is_file() else ()
    return sim, getattr(importlib.import_module(module), name)(sim, loader, proven) if name else None


def _build_one(recipe: Recipe, row: PoolRow, split: str, request: BuildRequest) -> dict[str, Any]:
    """In a worker process: the scenarios of one map, as plain data."""
    sim, certifier = _tools(request.root, request.workplace, request.certifier)
    source = kept_source(request.data, row.source, request.osm)
    return asdict(SiteBuilder(recipe, request.workplace, sim, certifier).build(row, source, split))


def _scenarios_of(data: dict[str, Any]) -> MapScenarios:
    rows = tuple(ScenarioSpec(**row) for row in data["rows"])
    certificates = tuple(Certificate(**c) for c in data["certificates"])
    return MapScenarios(data["map_id"], rows, certificates, data["reason"], tuple(data["rejected"]))


@cache
def _maker_fingerprint(placement: Path) -> str:
    """SHA-256 over all that decides what a placement's scenes look like: the code of other placements does not."""
    return digest({"code": closure([_MAKER, placement], _LEFT_OUT), "versions": versions()})


class TypeBuilder:
    """Fills one type's quotas in one split after the other."""

    def __init__(self, request: BuildRequest, recipe: Recipe, pool: Workers, split_of: dict[str, str]) -> None:
        self.request, self.recipe, self.pool, self.split_of = request, recipe, pool, split_of
        city = load_city(request.data.name)
        self.maps, self.withdrawn = city.maps, city.withdrawn
        placement = Path(inspect.getfile(type(placement_of(recipe))))
        self.key = f"{_maker_fingerprint(placement)}|{recipe}"

    def candidates(self, rows: Sequence[PoolRow], split: str) -> list[PoolRow]:
        """Maps of the split that the recipe's family takes and the city has not withdrawn, in the order of trying."""
        name = self.recipe.type.id
        usable = [
            r
            for r in rows
            if r.family == self.recipe.type.family
            and self.split_of[r.map_id] == places_of_split(split)
            and r.map_id not in self.withdrawn
        ]
        return sorted(usable, key=lambda r: (not r.well_tagged, seed_of("candidate", name, r.map_id), r.map_id))

    def fill(self, rows: Sequence[PoolRow], split: str, progress: Progress) -> tuple[list[MapScenarios], TypeReport]:
        """Sites for all quotas of a split; where the pool can't fill one, the recipe's other strata take over."""
        quota = {k: v * self.maps[split] // MAPS["train"] for k, v in self.recipe.maps.items()}
        wanted = max(sum(self.recipe.maps.values()) * self.maps[split] // MAPS["train"], 1)
        taken: list[MapScenarios] = []
        maps: list[PoolRow] = []
        reasons: Counter[str] = Counter()
        draws: Counter[str] = Counter()
        tried: set[str] = set()
        ordered = self.candidates(rows, split)
        for strict in (True, False):
            pick = [r for r in ordered if r.map_id not in tried and stratum_of(r) in self.recipe.maps]
            accept = quota if strict else {}
            for row, site in self._built(pick, split, maps, accept, wanted):
                tried.add(row.map_id)
                draws.update(map(_reason_class, site.rejected))
                if site.reason:
                    reasons[_reason_class(site.reason)] += 1
                    continue
                taken.append(site)
                maps.append(row)
                progress(f"{self.recipe.type.id} {split}", len(taken), wanted)
            if len(taken) >= wanted:
                break
        counts = Counter(map(stratum_of, maps))
        missed = {k: v - counts[k] for k, v in quota.items() if counts[k] < v}
        kind, there, short = self.recipe.type.id, dict(sorted(counts.items())), wanted - len(taken)
        return taken, TypeReport(
            kind, split, there, missed, short, dict(reasons.most_common()), dict(draws.most_common())
        )

    def _built(
        self, pick: list[PoolRow], split: str, taken: list[PoolRow], quota: dict[str, int], wanted: int
    ) -> Iterator[tuple[PoolRow, MapScenarios]]:
        """Builds candidates a few ahead, and gives them back strictly in order, those only that are still needed.

        taken: the maps that are, to which the caller adds what it takes.
        """
        apart = self.recipe.numbers.get("apart_m", APART_M)
        waiting = list(pick)
        running: list[tuple[PoolRow, Callable[[], dict[str, Any]]]] = []

        def needed(row: PoolRow, others: Sequence[PoolRow]) -> bool:
            """Would the row still be taken if `others` were?"""
            stratum, there = stratum_of(row), [*taken, *others]
            if len(there) >= wanted:
                return False
            if quota and sum(stratum_of(o) == stratum for o in there) >= quota[stratum]:
                return False
            return all((row.east - o.east) ** 2 + (row.north - o.north) ** 2 >= apart**2 for o in there)

        while True:
            # How far ahead is the same for any number of workers: which maps are taken depends on it.
            while len(running) < AHEAD:
                row = next((r for r in waiting if needed(r, [r for r, _ in running])), None)
                if row is None:
                    break
                waiting.remove(row)
                running.append((row, self._start(row, split)))
            if not running:
                return
            row, get = running.pop(0)
            data = get()
            if needed(row, ()):
                yield row, _scenarios_of(data)

    def _start(self, row: PoolRow, split: str) -> Callable[[], dict[str, Any]]:
        stamp = hashlib.sha256(f"{self.key}|{split}|{row}".encode()).hexdigest()
        kept = CachedResult(self.request.workplace / self.recipe.type.id / f"{row.map_id}.json", stamp)
        asked = (self.recipe, row, split, self.request)
        return self.pool.start(_build_one, *asked, kept=kept, sound=self._files_there)

    def _files_there(self, kept: dict[str, Any]) -> bool:
        named = (name for row in _scenarios_of(kept).rows for name in (row.net, row.additional))
        return all((self.request.workplace / name).is_file() for name in named)


def _reason_class(reason: str) -> str:
    """A reason without its numbers and names, for counting."""
    words = ["#" if any(c.isdigit() for c in w) else w for w in reason.split()]
    return " ".join(w for w in words if "/" not in w)


def build_scenarios(request: BuildRequest, progress: Progress) -> list[TypeReport]:
    """Build the asked types and write tables, certificates and report after each; other types' rows stay.

    Raises InputError where the pool or the extracts are missing. A type for which the pool has too few maps is kept as
    far as it goes, and its report says what is short.
    """
    data = request.data
    rows = read_pool(data.pool_path)
    city = load_city(data.name)
    split_of = split_pool(rows, city.split)
    recipes = load_recipes(data.catalog, request.types)
    reports: list[TypeReport] = []
    with worker_processes(request.workers, "building scenes") as pool:
        for split in (s for s in SPLITS if s in request.splits and s in city.maps):
            for recipe in (recipe for recipe in recipes if (recipe.last is not None) == (split in TWO_SIGNS)):
                sites, report = TypeBuilder(request, recipe, pool, split_of).fill(rows, split, progress)
                _keep(request, recipe.type.id, split, sites, rows)
                _write_report(request.root, report)
                reports.append(report)
    return reports


def _keep(request: BuildRequest, type_id: str, split: str, sites: list[MapScenarios], pool: Sequence[PoolRow]) -> None:
    """Replace one type's scenes, rows and certificates in one split."""
    root, built = request.root, SceneFolder(request.workplace)
    write_store(((s.map_id, _contents(built, s)) for s in sites), store_path(split, type_id, root))
    path = root / f"{split}.parquet"
    others = [s for s in read_table(path) if s.pair_type != type_id] if path.is_file() else []
    write_table(with_places([*others, *(r for s in sites for r in s.rows)], pool), path)
    kept = certificates_path(root)
    old = read_certificates(kept) if kept.is_file() else []
    new = [c for s in sites for c in s.certificates]
    remaining = (c for c in old if c.split != split or c.scenario_id.partition("-")[0] != type_id)
    write_certificates([*remaining, *new], kept)


def _contents(built: SceneFolder, site: MapScenarios) -> dict[str, bytes]:
    """The files that the rows of a map name."""
    named = {name: row for row in site.rows for name in (row.net, row.additional)}
    return {name: built.read(row, name).content for name, row in named.items()}


def _write_report(root: Path, report: TypeReport) -> None:
    path = root / "build_report.json"
    kept = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    fresh = [e for e in kept if (e["type_id"], e["split"]) != (report.type_id, report.split)]
    entries = sorted([*fresh, asdict(report)], key=lambda e: (e["type_id"], e["split"]))
    write_json(path, entries, indent=1, sort_keys=True)


def build_city(
    data: DataSet,
    types: tuple[str, ...],
    osm: Path,
    workers: int,
    progress: Progress,
    on_progress: Callable[[str], None] = lambda _: None,
) -> list[TypeReport]:
    """Build the data set of a city, of some types or () = all. Interrupted, it goes on where it was.

    on_progress: gets a line for each thing in the extracts that was not taken as it is.

    Raises InputError: an extract that is missing or another than the city's, or lies in another zone; no scenario.
    """
    city = load_city(data.name)
    if city.name == OWN_CITY:
        raise InputError(
            f"{city.name} is the benchmark's own: tsbench maps harvest and tsbench scenarios build make its data set"
        )
    pool = made_pool(data)
    for note in harvest(data, osm, pool, pool.with_name("harvest.json"), workers, progress).notes:
        on_progress(note)
    reports = build_scenarios(BuildRequest(data, types, osm, data.folder / "scenarios", workers), progress)
    if not any(data.table(split) for split in data.splits):
        why = dict.fromkeys(
            c.why
            for c in carried(city, read_pool(pool), load_recipes(data.catalog, types), build_report(report_file(data)))
        )
        raise InputError(
            f"{city.name}: its {len(read_pool(pool)):,} maps carry no scenario: {next(iter(why))}"
            f"{f', and {len(why) - 1} more reasons' if len(why) > 1 else ''} (tsbench city show {city.name})"
        )
    data.write_editions(dict.fromkeys(data.splits, editions()[-1].name))
    release_city(data, city.title)
    write_ground(data, osm)
    return reports
