"""One `tsbench run` from options to the ended run folder."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Protocol, cast

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.text import fault_in_name
from tsbench.episode.outcome import Outcome
from tsbench.metrics.aggregate import summarise
from tsbench.planners.planner_spec import PlannerSpec, import_attribute
from tsbench.run.edition import LOCAL, code_stamps, contract_hash, edition_here, standing_contract
from tsbench.run.execution.local import make_executor
from tsbench.run.execution.messages import ISOLATED, Executor, Setup, Task, TaskQueue
from tsbench.run.listener import Listener, Started
from tsbench.run.log.folder import RunFolder, check_folder
from tsbench.run.log.journal import Journal, read_table, write_tables
from tsbench.run.log.manifest import marks_of, new_manifest, planners_of
from tsbench.run.log.record import Record, Row
from tsbench.run.opened_files import what_is_unseen
from tsbench.run.options import RunOptions
from tsbench.run.plan import make_plan
from tsbench.run.planner_info import PlannerInfo, SandboxedPlanner, check_unchanged_since, code_hash_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

if TYPE_CHECKING:
    from tsbench.metrics.aggregate import Summary


class ProgressListener(Protocol):
    """A listener to the progress of a run."""

    def notice(self, line: str) -> None:
        """Something about the folder that its owner should know."""

    def begin(self, asked: Mapping[str, int], done: Iterable[Row]) -> None:
        """The run starts: so many episodes for each planner; `done`: rows of those finished earlier."""

    def episode(self, row: Row) -> None:
        """An episode is finished."""

    def end(self) -> None:
        """No more episodes come."""


@dataclass(frozen=True)
class RunResult:
    """How a run ended. status: complete or interrupted. errors: episodes with an error outcome.

    summary: None where episodes are missing and partial figures were not asked for.
    """

    folder: Path
    status: str
    asked: int
    finished: int
    errors: int
    contract: str
    summary: Summary | None


def run(options: RunOptions, watcher: ProgressListener, listeners: Sequence[Listener] = ()) -> RunResult:
    """Run, or continue, what the options ask for.

    Raises InputError: wrong options, bad input, or a folder that cannot be used; finished episodes are kept.
    """
    options.check()
    options, code = _in_image(options), code_stamps()
    data = DataSet.named(options.city)
    plan = make_plan(options, data)
    perception = options.perceived()
    contract = standing_contract(contract_hash(plan.table, data.catalog))
    effective = options.resolved(plan.types, len(plan.scenarios), perception)
    if options.out is not None and not options.overwrite:
        check_folder(options.out, contract, effective)
    episodes = len(plan.scenarios) * len(options.planners)
    limits = replace(options.limits, most_memory=options.memory_limit)
    with make_executor(options.executor, options.workers, episodes, limits) as pool:
        out = None if options.out is None else options.out.resolve()
        hidden = tuple(str(path) for path in (out, Path("runs").resolve()) if path is not None)
        # Before a line of their code runs.
        codes = [code_hash_of(PlannerSpec.parse(spec).text) for spec in options.planners]
        told = probe_isolated(options.planners, hidden) if options.isolate else None
        found = pool.probe(options.planners, options.device) if told is None else [one.planner for one in told]
        planners = distinct(found)
        names = [planner.name for planner in planners]
        keys = [(name, spec.scenario_id) for name in names for spec in plan.scenarios]
        manifest = new_manifest(contract, options.plain(), effective, planners, edition_here(contract, data))
        if told is not None:
            manifest["isolation"] = {one.planner.name: one.effects for one in told}
        folder_path = options.out or Path("runs") / options.folder_name(names, contract)
        with closing(RunFolder(folder_path, manifest, keys, options.overwrite)) as folder:
            for line in folder.notices:
                watcher.notice(line)
            if folder.journal is None:
                watcher.notice(_nothing_to_do(folder))
            asked = dict.fromkeys(names, plan.scenarios)
            counts = {name: len(rows) for name, rows in asked.items()}
            for listener in listeners:
                listener.started(Started(folder.path, contract, manifest["edition"], counts, manifest["asked"]))
            status, journal = "complete", folder.journal
            if journal is not None:
                place, split = str(folder.path.resolve()), options.split
                given = (planners, perception, options.device, options.trace, place, data, split, contract)
                loader = f"{ISOLATED}:load" if options.isolate else ""
                setup = Setup(*given, runner=options.runner, loader=loader, hidden=hidden)

                def keep(record: Record) -> None:
                    folder.keep(record)
                    watcher.episode(record.row)
                    for listener in listeners:
                        listener.episode(record.row)

                with stop_on_signals() as stopped:
                    drive(pool, setup, asked, journal, keep, stopped, watcher)
                    write_tables(folder.path, journal, contract)
                status = "complete" if len(journal.done) == len(keys) else "interrupted"
                # Which version made these rows is not known: the run stays interrupted, and "+local" stays with it.
                changed = _changed_meanwhile(code, zip(planners, codes, strict=True), folder)
                status = "interrupted" if changed else status
            ending = _ending(folder, status, counts, options)
            if journal is not None:
                folder.end(status, ending.summary, ending.errors, pool.memory())
                if changed is not None:
                    raise changed
            for listener in listeners:
                listener.finished(ending)
            return ending


def _changed_meanwhile(
    code: Mapping[Path, tuple[int, int]], planners: Iterable[tuple[PlannerInfo, str | None]], folder: RunFolder
) -> InputError | None:
    """The message where tsbench's code or a planner's changed during the run.

    code: `code_stamps` at its start. planners: each with its `code_hash_of` at the start.
    """
    if code_stamps() != code:
        folder.manifest["edition"] = f"{folder.manifest['edition'].removesuffix(LOCAL)}{LOCAL}"
        return InputError("tsbench's code has changed since the run began: start the run anew")
    try:
        for planner, before in planners:
            check_unchanged_since(planner, before)
        folder.check_later()
    except InputError as problem:
        return problem
    return None


def _in_image(options: RunOptions) -> RunOptions:
    """Planners' specifications with their image, so that the run can be repeated in it."""
    if options.image is None:
        return options
    if not options.isolate:
        raise InputError(f"--image {options.image}: planners run in an image isolated only: add --isolate")
    planners = tuple(str(PlannerSpec.parse(spec).in_image(options.image)) for spec in options.planners)
    return replace(options, planners=planners)


def probe_isolated(planners: Sequence[str], hidden: Sequence[str]) -> list[SandboxedPlanner]:
    """The facts of planners without a line of their code here, with what of their sandboxes took effect."""
    describe = cast("Callable[..., SandboxedPlanner]", import_attribute(ISOLATED, "describe", "--isolate"))
    return [describe(spec, [Path(place) for place in hidden]) for spec in planners]


def distinct(found: Sequence[PlannerInfo]) -> tuple[PlannerInfo, ...]:
    """Planners as they are; InputError where two would be one in records, or a name shows readers another one."""
    seen: dict[str, str] = {}
    for planner in found:
        if fault := fault_in_name(planner.name):
            raise InputError(f"--planner {planner.spec}: its name: {fault}: rename it")
        other = seen.setdefault(planner.name, planner.spec)
        if other != planner.spec:
            raise InputError(f"--planner {planner.spec}: called {planner.name} in records, like {other}: rename one")
    return tuple(found)


def drive(
    pool: Executor,
    setup: Setup,
    wanted: Mapping[str, Sequence[ScenarioSpec]],
    journal: Journal,
    keep: Callable[[Record], None],
    stop: Callable[[], bool],
    watcher: ProgressListener,
) -> None:
    """Drive what the journal does not have yet. wanted: scenarios by planner, in the order of the setup's."""
    keys = {(name, spec.scenario_id): None for name, specs in wanted.items() for spec in specs}
    watcher.begin(
        {name: len(specs) for name, specs in wanted.items()},
        (journal.read(key)["row"] for key in keys if key in journal.done),
    )
    todo = [
        (planner, spec)
        for planner, (name, specs) in enumerate(wanted.items())
        for spec in specs
        if (name, spec.scenario_id) not in journal.done
    ]
    try:
        if todo:
            pool.run(setup, TaskQueue(Task(n, *pair) for n, pair in enumerate(todo, start=1)), keep, stop)
    finally:
        watcher.end()


def _nothing_to_do(folder: RunFolder) -> str:
    """That a run is complete, and what of its planners may have changed without being seen."""
    unseen = sorted({name for planner in planners_of(folder.manifest) for name in planner.unseen})
    return (
        f"{folder.path}: complete since {folder.manifest['finished']}, nothing is driven"
        f"{what_is_unseen(unseen)}; --overwrite drives it again"
    )


def _ending(folder: RunFolder, status: str, asked: Mapping[str, int], options: RunOptions) -> RunResult:
    """How the run stands, from what its table of episodes says; no figures over holes unless asked for."""
    # Statistics take long to import, and nothing before the end needs them.
    contract = standing_contract(folder.manifest["contract"])
    episodes = read_table(folder.path / "episodes.parquet")
    holes = len(episodes) < sum(asked.values())
    summary = None
    if not holes or options.allow_partial:
        summary = summarise(
            episodes,
            contract_hash=contract,
            edition=folder.manifest["edition"],
            asked=asked,
            marks=marks_of(folder.manifest),
            allow_partial=options.allow_partial,
        )
    return RunResult(folder.path, status, sum(asked.values()), len(episodes), count_errors(episodes), contract, summary)


def count_errors(episodes: pa.Table) -> int:
    return sum(Outcome(str(name)).is_error for name in episodes["outcome"].to_pylist())


@contextmanager
def stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and SIGTERM ask to stop between two steps, so that no file is cut; a second one breaks off."""
    asked: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
