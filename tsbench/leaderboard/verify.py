"""A submission driven again: some of its episodes, drawn by whoever verifies, must come out as they stand there."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.plain import from_plain
from tsbench.core.seeds import rng_of
from tsbench.core.textfile import read_json
from tsbench.leaderboard.submission import Episode, Submission, episode_of, figures_of, read_submission
from tsbench.run import arithmetic
from tsbench.run.contract import contract_hash
from tsbench.run.execution.base import Limits
from tsbench.run.execution.factory import make_executor
from tsbench.run.execution.messages import ISOLATED, Setup
from tsbench.run.execution.task_queue import Task, TaskQueue
from tsbench.run.isolation.loading import describe
from tsbench.run.log.manifest import machine
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog

KIND, SCHEMA_VERSION = "tsbench-verification", 1
# Rounded as figures are shown: the bootstrap's own draws are of the contract, and so the same.
_DIGITS = 6


@dataclass(frozen=True)
class Difference:
    """What is not as submitted. scenario_id: "" for what is not of one episode."""

    scenario_id: str
    what: str


@dataclass(frozen=True)
class Verification:
    """submission_sha256: of the file that was verified. verifier: who says so. seed, sample: of the draw.

    driven: scenario ids; equal: how many of them have the digest that was submitted. explained: those whose verdict is
    as submitted but whose digest is another, which `arithmetic_difference` may explain. differences: what is wrong.
    """

    submission_sha256: str
    title: str
    verifier: str
    date: str
    tsbench: str
    seed: int
    sample: int
    driven: tuple[str, ...]
    equal: int
    explained: tuple[str, ...]
    arithmetic_difference: str
    differences: tuple[Difference, ...]
    arithmetic: dict[str, Any]
    machine: dict[str, Any]

    @property
    def confirmed(self) -> bool:
        return not self.differences

    def to_json(self) -> str:
        content = {"kind": KIND, "schema": SCHEMA_VERSION, "confirmed": self.confirmed, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def read_verification(path: Path) -> Verification:
    """The record of a verification. Raises InputError for what is none."""
    data = read_json(path, "record of a verification")
    if not isinstance(data, dict) or data.pop("kind", None) != KIND:
        raise InputError(f"{path}: no record of a verification (expected `kind: {KIND}`)")
    if (version := data.pop("schema", None)) != SCHEMA_VERSION:
        raise InputError(f"{path}: schema {version!r:.20}, this tsbench reads {SCHEMA_VERSION}")
    said = data.pop("confirmed", None)
    try:
        found = from_plain(Verification, data)
    except (ValueError, TypeError) as problem:
        raise InputError(f"{path}: malformed ({' '.join(str(problem).split())[:200]})") from None
    if said is not found.confirmed:
        raise InputError(f"{path}: says confirmed: {said}, which its differences do not")
    return found


def verify(
    path: Path, planner: str | None, *, sample: int, seed: int, verifier: str, workers: int | None,
    told: Callable[[int, int], None],
) -> Verification:  # fmt: skip
    """Drive `sample` episodes of the submission in a file again and compare.

    planner: what to drive, as for `tsbench run`; None: as the submission names it. told: how many are done, of how
    many. Raises InputError: no submission, another contract here, or no such planner.
    """
    submitted = read_submission(path)
    table = sorted(read_table(table_path(submitted.split)), key=lambda row: row.scenario_id)
    contract = contract_hash(table, load_catalog())
    if contract != submitted.contract:
        raise InputError(
            f"{path}: its contract is {submitted.contract[:12]}, that of this tsbench {contract[:12]}: verify it with "
            f"tsbench {submitted.tsbench} and the data of {submitted.edition}"
        )
    found = list(_figures(submitted, table))
    specs = _draw(submitted, table, sample, seed)
    info, records = _drive(planner or submitted.planner.spec, submitted, specs, workers, told)
    found += _of_planner(info, submitted.planner)
    here = arithmetic.facts()
    why = arithmetic.difference(submitted.arithmetic, here, [submitted.planner.spec], submitted.device) or ""
    theirs = {episode.scenario_id: episode for episode in submitted.episodes}
    equal, explained = 0, []
    for episode in records:
        then = theirs[episode.scenario_id]
        if episode.digest == then.digest and episode.verdict == then.verdict:
            equal += 1
        elif episode.verdict == then.verdict and why:
            explained.append(episode.scenario_id)
        else:
            found.append(Difference(episode.scenario_id, _words(then, episode)))
    return Verification(
        submission_sha256=hashlib.sha256(path.read_bytes()).hexdigest(), title=submitted.title, verifier=verifier,
        date=f"{datetime.now(UTC):%Y-%m-%d}", tsbench=tsbench.__version__, seed=seed, sample=sample,
        driven=tuple(spec.scenario_id for spec in specs), equal=equal, explained=tuple(explained),
        arithmetic_difference=why, differences=tuple(found), arithmetic=here, machine=machine(),
    )  # fmt: skip


def _figures(submitted: Submission, table: Sequence[ScenarioSpec]) -> Iterator[Difference]:
    """Figures that do not follow from the episodes beside them."""
    try:
        now = figures_of(submitted.episodes, table, submitted.planner, submitted.contract)
    except InputError as problem:
        yield Difference("", str(problem))
        return
    told = {(f.figure, f.over): f for f in submitted.figures}
    for figure in now:
        then = told.pop((figure.figure, figure.over), None)
        if then is None or _rounded(then) != _rounded(figure):
            said = "missing" if then is None else _rounded(then)
            yield Difference(
                "",
                f"{figure.figure} of {figure.over} is {said}, by its episodes {_rounded(figure)}",
            )
    for figure_name, over in told:
        yield Difference("", f"{figure_name} of {over}: no such figure follows from its episodes")


def _rounded(figure: Any) -> tuple[Any, ...]:
    values = (figure.value, figure.low, figure.high)
    return (*(None if v is None else round(v, _DIGITS) for v in values), figure.n)


def _draw(submitted: Submission, table: Sequence[ScenarioSpec], sample: int, seed: int) -> list[ScenarioSpec]:
    """Episodes of the submission, drawn without replacement, in the order of their ids."""
    there = {episode.scenario_id for episode in submitted.episodes}
    rows = [spec for spec in table if spec.scenario_id in there]
    chosen = rng_of("verify", submitted.contract, seed).choice(
        len(rows), min(sample, len(rows)), replace=False
    )
    return [rows[k] for k in sorted(chosen)]


def _drive(
    planner: str, submitted: Submission, specs: Sequence[ScenarioSpec], workers: int | None,
    told: Callable[[int, int], None],
) -> tuple[PlannerInfo, list[Episode]]:  # fmt: skip
    """What the planner is, and what becomes of the episodes here, in the order of their ids."""
    done: list[Episode] = []

    def keep(record: Record) -> None:
        done.append(episode_of(record.row, record.events))
        told(len(done), len(specs))

    with make_executor("local", workers, len(specs), Limits()) as pool, tempfile.TemporaryDirectory() as out:
        alone = submitted.isolation is not None
        # As it was driven: the verifier's processes run none of its code either.
        info = describe(planner).planner if alone else pool.probe([planner])[0]
        setup = Setup(
            (info,), False, submitted.device, "none", out, submitted.split, submitted.contract,
            loader=ISOLATED if alone else "",
        )  # fmt: skip
        tasks = TaskQueue(Task(number, 0, spec) for number, spec in enumerate(specs, start=1))
        pool.run(setup, tasks, keep, lambda: False)
    return info, sorted(done, key=lambda episode: episode.scenario_id)


def _of_planner(here: PlannerInfo, there: PlannerInfo) -> Iterator[Difference]:
    """In what two planners differ that decides how they drive, or how their row is shown."""
    for key in ("weights_sha256", "code_sha256", "privileged", "sign_access", "floor"):
        ours, theirs = getattr(here, key), getattr(there, key)
        if ours != theirs:
            yield Difference("", f"the planner's {key} is {_short(theirs)} as submitted, {_short(ours)} here")


def _short(value: object) -> str:
    return value[:12] if isinstance(value, str) else str(value)


def _words(then: Episode, now: Episode) -> str:
    if then.verdict != now.verdict:
        return f"verdict is {_verdict(then)} as submitted, {_verdict(now)} driven again"
    return f"digest is {then.digest} as submitted, {now.digest} driven again, on the same arithmetic"


def _verdict(episode: Episode) -> str:
    passed = "passed" if episode.scd else "failed"
    clauses = f" ({', '.join(episode.clauses)})" if episode.clauses else ""
    return f"{episode.outcome}, {passed}{clauses}"
