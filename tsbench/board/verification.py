"""Drives some episodes of a claim again, drawn by the verifier: each must come out as claimed."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import tsbench
from tsbench.board.claim import Claim
from tsbench.board.isolation.isolated_loading import changed_files, describe
from tsbench.board.submission import Figure, SubmittedEpisode, episode_of, fault_of_lines, figures_of
from tsbench.core.errors import InputError
from tsbench.core.seeds import rng_of
from tsbench.core.text import fault_in_name, one_line
from tsbench.core.textfile import read_json
from tsbench.core.typed import typed
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.run import arithmetic
from tsbench.run.edition import LOCAL, code_is_local, contract_now, edition_of, standing_contract
from tsbench.run.execution.local import make_executor
from tsbench.run.execution.messages import ISOLATED, Limits, Setup, Task, TaskQueue
from tsbench.run.log.manifest import machine
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

KIND, SCHEMA_VERSION = "tsbench-verification", 3
# Rounded as figures are shown: the bootstrap's own draws are of the contract, and so the same.
_DIGITS = 6
# Of the episodes of a claim that is confirmed. Another libm (glibc's without FMA) changed 2 of 30 dev episodes of
# `idm-e`.
_HIGH_SHARE = 0.25
_SHOWN = 5


class ClaimVerdict(StrEnum):
    """What a second drive says of a claim. CONFIRMED: byte for byte."""

    CONFIRMED = "confirmed"
    VERDICTS_ONLY = "verdicts equal, bytes not comparable"
    REFUTED = "refuted"


@dataclass(frozen=True)
class Mismatch:
    """What is not as submitted. scenario_id: "" for what is not of one episode."""

    scenario_id: str
    what: str


@dataclass(frozen=True)
class Verification:
    """What came of a second drive.

    submission_sha256: of what was verified: of what a submission says, or of a run's table of episodes. verifier: who
    says so. seed, sample: of the draw.

    driven: scenario ids; equal: how many of them have the digest that was submitted. explained: those whose verdict is
    as submitted but whose digest is another, which `arithmetic_differences` may explain: what the claim says of its
    arithmetic, against what is here. differences: what is wrong.
    isolated: the planner had a process of its own. files: of the planner's own that drove then, as in `PlannerInfo`.
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
    arithmetic_differences: tuple[str, ...]
    differences: tuple[Mismatch, ...]
    arithmetic: dict[str, Any]
    machine: dict[str, Any]
    isolated: bool
    files: tuple[str, ...] = ()

    @property
    def verdict(self) -> ClaimVerdict:
        """What explains other bytes is the claim's own word: where many are others, only verdicts speak for it."""
        if self.differences:
            return ClaimVerdict.REFUTED
        few = len(self.explained) <= _HIGH_SHARE * len(self.driven)
        return ClaimVerdict.CONFIRMED if few else ClaimVerdict.VERDICTS_ONLY

    @property
    def good(self) -> bool:
        """Is it confirmed, and out of the planner's reach?"""
        return self.verdict is ClaimVerdict.CONFIRMED and self.isolated

    def to_json(self) -> str:
        content = {"kind": KIND, "schema": SCHEMA_VERSION, "verdict": self.verdict, **asdict(self)}
        return json.dumps(content, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def read_verification(path: Path) -> Verification:
    """The record of a verification. Raises InputError for other files, and for counts that contradict each other."""
    data = read_json(path, "record of a verification")
    if not isinstance(data, dict) or data.pop("kind", None) != KIND:
        raise InputError(f"{path}: no record of a verification (expected `kind: {KIND}`)")
    if (version := data.pop("schema", None)) != SCHEMA_VERSION:
        raise InputError(f"{path}: schema {version!r:.20}, this tsbench reads {SCHEMA_VERSION}")
    said = data.pop("verdict", None)
    try:
        found = typed(Verification, data)
    except (ValueError, TypeError) as problem:
        raise InputError(f"{path}: malformed ({' '.join(str(problem).split())[:200]})") from None
    by = found.verifier and fault_in_name(found.verifier)
    if fault := _fault_of_counts(found) or fault_of_lines(data) or by:
        raise InputError(f"{path}: {fault}")
    if said != found.verdict:
        raise InputError(f"{path}: says {said!r:.60}, by its counts it is {found.verdict!s}")
    return found


def _fault_of_counts(found: Verification) -> str:
    """What in a record cannot be of a drive, "" where nothing is."""
    driven = {*found.driven}
    wrong = {difference.scenario_id for difference in found.differences} - {""}
    if not driven or len(driven) != len(found.driven):
        return "no episode was driven, or one twice"
    told = f"of {len(driven)} driven episodes {found.equal} are equal"
    if not {*found.explained} | wrong <= driven or found.equal + len(found.explained) + len(wrong) != len(driven):
        return f"{told}, {len(found.explained)} explained and {len(wrong)} wrong: the counts do not fit"
    if found.explained and not found.arithmetic_differences:
        return f"{len(found.explained)} episodes have other bytes, and nothing explains them"
    return ""


def verify(
    claim: Claim,
    planner: str | None,
    *,
    sample: int,
    seed: int,
    verifier: str,
    workers: int | None,
    on_progress: Callable[[int, int], None],
    shared_process: bool = False,
) -> Verification:
    """Drive `sample` episodes of a claim again and compare.

    planner: what to drive, as for `tsbench run`; None: as the claim names it. on_progress: gets how many are done, and
    of how many.
    It is driven isolated, however the claim's was: the bytes are the same, but for a planner that changes its referee.
    shared_process: beside the referee, for a planner whose code the verifier trusts. A claim says nothing on this.
    Raises InputError: another contract here, no such planner, or one that was driven on what no isolated planner has.
    """
    if fault := verifier and fault_in_name(verifier):
        raise InputError(f"--by {fault}")
    if claim.device != "cpu" and not shared_process:
        raise InputError(
            f"{claim.path}: was driven on {claim.device}, and isolated planners run on the CPU: if you trust the "
            "planner's code, --shared-process drives it so beside the referee"
        )
    driven = planner or claim.planner.spec
    if shared_process and PlannerSpec.parse(driven).isolated_only:
        raise InputError(f"--shared-process: {driven!r:.60} is driven isolated only: leave it out")
    data = DataSet.named(claim.city)
    table = sorted(data.table(claim.split), key=lambda row: row.scenario_id)
    contract = contract_now(data, claim.split)
    if standing_contract(contract) != standing_contract(claim.contract):
        raise InputError(
            f"{claim.path}: its contract is {claim.contract[:12]}, that of this tsbench {contract[:12]}: verify it "
            f"with tsbench {claim.tsbench} and the data of {claim.edition}"
        )
    found = list(_strange(claim, table) if claim.figures is None else _figures(claim, table, claim.figures))
    name = edition_of(claim.contract, claim.edition, data).removesuffix(LOCAL)
    if name != claim.edition.removesuffix(LOCAL):
        found.append(Mismatch("", f"its edition is {claim.edition} as submitted, {name} by its contract"))
    specs = draw(claim.contract, claim.episodes, table, sample, seed)
    info, records = _drive(driven, claim, specs, not shared_process, workers, on_progress)
    if info.name != claim.planner.name:
        found.append(Mismatch("", f"the planner is called {claim.planner.name} as submitted, {info.name} here"))
    found += _of_planner(info, claim.planner)
    here = arithmetic.facts()
    # By what drove here: what the claim calls its planner is the claim's word.
    why = arithmetic.differences(claim.arithmetic, here, [info.spec], claim.device)
    theirs = {episode.scenario_id: episode for episode in claim.episodes}
    equal, explained = 0, []
    for episode in records:
        then = theirs[episode.scenario_id]
        if episode.digest == then.digest and episode.verdict == then.verdict:
            equal += 1
        elif episode.verdict == then.verdict and why:
            explained.append(episode.scenario_id)
        else:
            found.append(Mismatch(episode.scenario_id, _words(then, episode)))
    return Verification(
        submission_sha256=claim.sha256, title=claim.title, verifier=verifier,
        date=f"{datetime.now(UTC):%Y-%m-%d}", tsbench=f"{tsbench.__version__}{LOCAL * code_is_local()}",
        seed=seed, sample=sample,
        driven=tuple(spec.scenario_id for spec in specs), equal=equal, explained=tuple(explained),
        # What a claim says of itself may be long.
        arithmetic_differences=tuple(map(one_line, why)),
        differences=tuple(Mismatch(one.scenario_id, one_line(one.what)) for one in found),
        arithmetic=here, machine=machine(), isolated=not shared_process, files=info.files,
    )  # fmt: skip


def _strange(claim: Claim, table: Sequence[ScenarioSpec]) -> Iterator[Mismatch]:
    """Episodes of no row of the split, which cannot be driven again."""
    known = {spec.scenario_id for spec in table}
    strange = sorted(e.scenario_id for e in claim.episodes if e.scenario_id not in known)
    if strange:
        shown = ", ".join(strange[:_SHOWN])
        yield Mismatch("", f"{len(strange)} of its episodes are of no row of {claim.split}: {shown}")


def _figures(claim: Claim, table: Sequence[ScenarioSpec], figures: Sequence[Figure]) -> Iterator[Mismatch]:
    """Figures that do not follow from the episodes beside them."""
    try:
        now = figures_of(claim.episodes, table, claim.planner, claim.contract)
    except InputError as problem:
        yield Mismatch("", str(problem))
        return
    told = {(f.figure, f.over): f for f in figures}
    for figure in now:
        then = told.pop((figure.figure, figure.over), None)
        if then is None or _rounded(then) != _rounded(figure):
            said = "missing" if then is None else _rounded(then)
            yield Mismatch("", f"{figure.figure} of {figure.over} is {said}, by its episodes {_rounded(figure)}")
    for figure_name, over in told:
        yield Mismatch("", f"{figure_name} of {over}: no such figure follows from its episodes")


def _rounded(figure: Any) -> tuple[Any, ...]:
    values = (figure.value, figure.low, figure.high)
    return (*(None if v is None else round(v, _DIGITS) for v in values), figure.n)


def draw(
    contract: str, episodes: Sequence[SubmittedEpisode], table: Sequence[ScenarioSpec], sample: int, seed: int
) -> list[ScenarioSpec]:
    """Episodes of a claim, drawn without replacement, in the order of their ids."""
    there = {episode.scenario_id for episode in episodes}
    rows = sorted((spec for spec in table if spec.scenario_id in there), key=lambda row: row.scenario_id)
    chosen = rng_of("verify", contract, seed).choice(len(rows), min(sample, len(rows)), replace=False)
    return [rows[k] for k in sorted(chosen)]


def _drive(
    planner: str,
    claim: Claim,
    specs: Sequence[ScenarioSpec],
    isolated: bool,
    workers: int | None,
    on_progress: Callable[[int, int], None],
) -> tuple[PlannerInfo, list[SubmittedEpisode]]:
    """What the planner is, and what becomes of the episodes here, in the order of their ids."""
    done: list[SubmittedEpisode] = []

    def keep(record: Record) -> None:
        done.append(episode_of(record.row, record.events))
        on_progress(len(done), len(specs))

    with make_executor("local", workers, len(specs), Limits()) as pool, tempfile.TemporaryDirectory() as out:
        # Of an isolated planner the verifier's processes run no code either.
        if isolated:
            info = describe(planner, only=claim.planner.files).planner
        else:
            (info,) = pool.probe([planner], claim.device)
        split, contract, loader = claim.split, claim.contract, f"{ISOLATED}:load_alone" if isolated else ""
        data = DataSet.named(claim.city)
        given = ((info,), claim.perception, claim.device, "none", out, data, split, contract)
        setup = Setup(*given, loader=loader)
        tasks = TaskQueue(Task(number, 0, spec) for number, spec in enumerate(specs, start=1))
        pool.run(setup, tasks, keep, lambda: False)
    return info, sorted(done, key=lambda episode: episode.scenario_id)


def _of_planner(here: PlannerInfo, there: PlannerInfo) -> Iterator[Mismatch]:
    """In what two planners differ that decides how they drive, or how their row is shown."""
    for key in ("weights_sha256", "code_sha256", "privileged", "sign_access", "floor"):
        ours, theirs = getattr(here, key), getattr(there, key)
        if ours != theirs:
            yield Mismatch("", f"the planner's {key} is {_short(theirs)} as submitted, {_short(ours)} here")
    # What lies beside its code travels with it; other places are each machine's own.
    if names := changed_files(here.spec, there):
        yield Mismatch("", f"the planner has other files than as submitted: {', '.join(names[:_SHOWN])}")


def _short(value: object) -> str:
    return value[:12] if isinstance(value, str) else str(value)


def _words(then: SubmittedEpisode, now: SubmittedEpisode) -> str:
    if then.verdict != now.verdict:
        return f"verdict is {_verdict(then)} as submitted, {_verdict(now)} driven again"
    return f"digest is {then.digest} as submitted, {now.digest} driven again, on the same arithmetic"


def _verdict(episode: SubmittedEpisode) -> str:
    passed = "passed" if episode.scd else "failed"
    clauses = f" ({', '.join(episode.clauses)})" if episode.clauses else ""
    return f"{episode.outcome}, {passed}{clauses}"
