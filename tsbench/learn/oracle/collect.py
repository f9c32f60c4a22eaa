"""`tsbench oracle collect`: all experts on the scenarios of a split. Runs on the workers of `tsbench.run`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tsbench.core.benchmark import VARIANTS
from tsbench.core.errors import InputError
from tsbench.core.seeds import seed_of
from tsbench.episode.perception_level import EXACTLY
from tsbench.learn.oracle.store import KIND, Collection, basis, check_folder
from tsbench.planners.registry import entry, names
from tsbench.run.execution.local import make_executor
from tsbench.run.execution.messages import Executor, Limits, Setup
from tsbench.run.log.manifest import new_manifest
from tsbench.run.log.record import Record
from tsbench.run.options import RunOptions
from tsbench.run.plan import RunPlan, make_plan
from tsbench.run.planner_info import PlannerInfo
from tsbench.run.session import ProgressListener, distinct, drive, stop_on_signals
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

TRIES = 4
LEAST_LEARNED_VARIANTS = 4


@dataclass(frozen=True, kw_only=True)
class CollectOptions:
    """Everything that `tsbench oracle collect` takes. request: which experts and scenarios.

    learned_variants: of the ten variants of a type on a map, so many are driven by experts with networks.
    tries: drives of a scenario by one expert at most. workers: processes, None = one for each core. redrive: what other
    code of an expert has driven is driven again.
    """

    request: RunOptions
    learned_variants: int = VARIANTS
    tries: int = TRIES
    workers: int | None = None
    redrive: bool = False
    out: Path


@dataclass
class ExpertCounts:
    """What an expert did. asked: scenarios; finished: those that are there; at_once, solved: with the first driver,
    with any; drives: tries of all; errors: scenarios on which its last drive broke off.

    longest: most tries of a scenario that stayed unsolved; 1 = it draws no driver, so nothing was tried again.
    """

    asked: int
    finished: int = 0
    at_once: int = 0
    solved: int = 0
    drives: int = 0
    errors: int = 0
    longest: int = 0

    def take(self, row: Mapping[str, Any]) -> None:
        tries = len(row["tries"])
        self.finished += 1
        self.drives += tries
        self.solved += row["scd"]
        self.at_once += row["scd"] and tries == 1
        self.errors += row["error"] is not None
        self.longest = self.longest if row["scd"] else max(self.longest, tries)


@dataclass(frozen=True)
class Collected:
    """How a collection stands: what each expert that was asked for did."""

    folder: Path
    experts: Mapping[str, ExpertCounts]

    @property
    def complete(self) -> bool:
        return all(counts.finished == counts.asked for counts in self.experts.values())


def experts() -> tuple[str, ...]:
    """Those that lead a planner; who obeys what it was told of a plate (`reader`) teaches nothing more."""
    return tuple(name for name in names() if entry(name).kind == "expert" and name.endswith("-e"))


def collect(data: DataSet, options: CollectOptions, watcher: ProgressListener) -> Collected:
    """Drive what is not there yet. Raises InputError for wrong options or a folder that cannot be used."""
    if not LEAST_LEARNED_VARIANTS <= options.learned_variants <= VARIANTS:
        raise InputError(
            f"--learned-variants {options.learned_variants}: expected {LEAST_LEARNED_VARIANTS} to {VARIANTS}"
        )
    plan = make_plan(options.request, data)
    effective = {"collection": KIND, "split": options.request.split, "tries": options.tries}
    # Without rows: each line knows the row that it was driven on, so the table may grow.
    contract = basis(data)
    check_folder(options.out, {"contract": contract, "effective": effective})
    most = len(plan.scenarios) * len(options.request.planners)
    with make_executor("local", options.workers, most, Limits()) as pool:
        planners = distinct(pool.probe(options.request.planners))
        for planner in planners:
            if not planner.privileged:
                raise InputError(f"--planner {planner.spec}: is no expert: it is not told the rule")
        asked = {**asdict(options), "out": str(options.out)}
        del asked["redrive"]
        manifest = new_manifest(contract, {**asked.pop("request"), **asked}, effective, planners)
        with closing(Collection(options.out, manifest, plan.table, planners, options.redrive)) as collection:
            for line in collection.notices:
                watcher.notice(line)
            return _collect(data, options, plan, pool, planners, collection, watcher)


def _collect(
    data: DataSet,
    options: CollectOptions,
    plan: RunPlan,
    pool: Executor,
    planners: tuple[PlannerInfo, ...],
    collection: Collection,
    watcher: ProgressListener,
) -> Collected:
    wanted = {
        p.name: plan.scenarios
        if p.weights_sha256 is None
        else chosen(plan.scenarios, options.learned_variants, first_variant(p.name))
        for p in planners
    }
    journal = collection.journal
    setup = Setup(
        planners,
        EXACTLY,
        device="cpu",
        trace="none",
        out=str(collection.path.resolve()),
        data=data,
        split=options.request.split,
        contract=collection.manifest["contract"],
        runner="tsbench.learn.oracle.trajectories:OracleRunner",
        recorder="tsbench.learn.oracle.trajectories:record_of",
        options={"most": options.tries, "probe": asdict(plan.table[0])},
    )

    def keep(record: Record) -> None:
        watcher.episode(collection.keep(record))

    with stop_on_signals() as stopped:
        drive(pool, setup, wanted, journal, keep, stopped, watcher)
        found = {name: ExpertCounts(len(specs)) for name, specs in wanted.items()}
        for name, specs in wanted.items():
            for spec in specs:
                if (name, spec.scenario_id) in journal.done:
                    found[name].take(journal.read((name, spec.scenario_id))["row"])
        collected = Collected(collection.path, found)
        collection.end(collected.complete)
    return collected


def first_variant(expert: str) -> int:
    """Where among a map's shuffled variants an expert with a network begins: registered ones share the ten evenly.

    So a few of them with few variants each still drive every variant once. One that is not registered begins first.
    """
    learned = [name for name in experts() if entry(name).weights is not None]
    return VARIANTS * learned.index(expert) // len(learned) if expert in learned else 0


def chosen(rows: Sequence[ScenarioSpec], variants: int, first: int = 0) -> list[ScenarioSpec]:
    """Of each type and map, `variants` of its variants from the `first` of the shuffled ones on, each with both halves.

    Fewer are a part of more.
    """
    by_map: dict[tuple[str, str], set[str]] = {}
    for row in rows:
        by_map.setdefault((row.pair_type, row.map_id), set()).add(row.pair_name)
    kept: set[str] = set()
    for group in by_map.values():
        shuffled = sorted(group, key=lambda name: (seed_of(KIND, "variants", name), name))
        kept.update((shuffled[first:] + shuffled[:first])[:variants])
    return [row for row in rows if row.pair_name in kept]
