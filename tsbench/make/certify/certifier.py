"""Drives a scenario row and says what that proves. Source: docs/scenes.md, "Certificates".

Certificates are renewed by driving each row in another process than the one that certified it; this can be resumed.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from tsbench.core.errors import InputError
from tsbench.core.parallel import CachedResult, worker_processes
from tsbench.episode.episode import Episode
from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.make.certify.evidence import (
    AnswerReplay,
    Habit,
    Prejudiced,
    Recorder,
    Watcher,
    alike_to_others,
    arrival_gap,
    braking_before,
    braking_to_meet,
    drawn_habits,
    line_point,
    others_differ,
    overlapping_pairs,
    road_users,
)
from tsbench.metrics.scd import is_scd
from tsbench.planners.base import Control, Trajectory
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.edition import SCORING, code_hash
from tsbench.scenarios.certificates import Certificate, bases, certificates_path, read_certificates, write_certificates
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneStore
from tsbench.sim.convoy import Approach, Showing
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import WorldSnapshot

# In the order in which they are asked; the first that solves a row stands in its certificate.
EXPERTS = ("idm-e", "idm-s3-e", "idm-s4-e")
Problem = tuple[str, str]
_Batch = list[tuple[ScenarioSpec, Certificate]]


@dataclass(frozen=True)
class _Drive:
    """An episode, and what its driver was told, first shown and answered."""

    result: EpisodeResult
    seen: Recorder

    @property
    def passed(self) -> bool:
        """Did it get SCD?"""
        return _is_passed(self.result)


@dataclass(frozen=True)
class _Proof:
    """One half as it was proven: the expert's drive (the first's where none passes) and the blind baseline's."""

    spec: ScenarioSpec
    solver: str
    solved: _Drive
    blind: _Drive


# Of a pair's rows, and of a square's, those that differ in one sign.
_APART = {2: ((0, 1),), 4: ((0, 1), (2, 3), (0, 2), (1, 3))}


class Certifier:
    """Proves rows in the process's one simulation. loader: gives their scenes; proven: certificates of before."""

    expert: str = EXPERTS[0]

    def __init__(self, simulation: Simulation, loader: SceneLoader, proven: Iterable[Certificate] = ()) -> None:
        self._simulation, self._loader = simulation, loader
        # One that another process refuted proves nothing.
        trusted = (one for one in proven if one.scoring == SCORING and one.reproduced is not False)
        self._known = {one.scenario_id: one for one in trusted}
        self._loaded: dict[str, LoadedPlanner] = {}
        self._proofs: dict[str, _Proof] = {}

    def prove(
        self, spec: ScenarioSpec, blind_baseline: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        """The certificate of a row. blind_baseline: the sign-blind driver's name. asked, realised: cars per lane-km."""
        solver, solved = self._solve(spec)
        blind = self._drive(blind_baseline, spec)
        if any(other.spec.pair_name != spec.pair_name for other in self._proofs.values()):
            self._proofs.clear()
        self._proofs[spec.scenario_id] = _Proof(spec, solver, solved, blind)
        facts, calm = blind.result.facts, solved.result.facts
        return Certificate(
            scenario_id=spec.scenario_id, scenario_type=spec.scenario_type, split=spec.split, attempt=attempt,
            expert=solver, expert_time_s=_time(solved.result) if solver else math.nan, blind_baseline=blind_baseline,
            blind_outcome=blind.result.outcome.value, tempting=not blind.passed,
            engaged=facts is not None and facts.verdicts.engaged, asked_density=asked, realised_density=realised,
            road_users=0 if facts is None else road_users(facts),
            overlaps=0 if calm is None else overlapping_pairs(calm),
            arrival_gap_s=math.nan if facts is None else arrival_gap(facts),
            error=solved.result.error or blind.result.error, digest=_digest(solved.result, blind.result),
            basis=bases([spec])[spec.scenario_id], scoring=SCORING, reproduced=None,
        )  # fmt: skip

    def known(self, rows: Sequence[ScenarioSpec], blind_baseline: str) -> tuple[Certificate, ...]:
        """The certificates of rows that were proven before on the same scenes; () where one was not.

        The same basis, scoring and blind baseline: a drive of these rows shows the same.
        """
        asked = {name: (basis, blind_baseline) for name, basis in bases(rows).items()}
        there = (self._known[name] for name in asked if name in self._known)
        found = tuple(one for one in there if (one.basis, one.blind_baseline) == asked[one.scenario_id])
        return found if len(found) == len(rows) else ()

    def compare(self, proven: Sequence[Certificate]) -> tuple[Certificate, ...]:
        """They with what each two that differ in one sign show. Raises ValueError unless `prove` drove them last."""
        for one in proven:
            if one.scenario_id not in self._proofs:
                raise ValueError(f"{one.scenario_id} was not proven last")
        found = list(proven)
        for a, b in _APART.get(len(found), ()):
            found[a], found[b] = self._compare(found[a], found[b])
        return tuple(found)

    def _compare(self, signed: Certificate, contrast: Certificate) -> tuple[Certificate, Certificate]:
        a, b = self._proofs[signed.scenario_id], self._proofs[contrast.scenario_id]
        tried = ((a, *self._tried_on(a, b.spec)), (b, *self._tried_on(b, a.spec)))
        always = (f"who always obeys the {one.spec.half} plate" for one, _, obeying in tried if obeying)
        passed_by = a.blind.result.planner if a.blind.passed and b.blind.passed else next(always, "")
        differs_s, brake = self._reaction(a, b)
        blind_equal = a.blind.seen.view == b.blind.seen.view != ""
        shown = not any(replayed for _, replayed, _ in tried), passed_by, blind_equal, differs_s, brake
        return signed.beside(*shown), contrast.beside(*shown)

    def again(self, rows: Sequence[tuple[ScenarioSpec, Certificate]]) -> list[Certificate]:
        """A row, or all of a pair or a square, driven once more.

        `reproduced` where it shows the same, whatever code drove it before, and where. What only the builder measures
        (attempt, densities) is kept.
        """
        new = [
            self.prove(spec, old.blind_baseline, old.attempt, old.asked_density, old.realised_density)
            for spec, old in rows
        ]
        both = self.compare(new) if all(c.solvable for c in new) else new
        return [
            replace(fresh, reproduced=not old.differences(fresh)) for (_, old), fresh in zip(rows, both, strict=True)
        ]

    def _solve(self, spec: ScenarioSpec) -> tuple[str, _Drive]:
        """The first expert that gets SCD and its episode; "" and the first expert's episode if none does."""
        drives = []
        for name in EXPERTS:
            drives.append(self._drive(name, spec))
            if drives[-1].passed:
                return name, drives[-1]
        return "", drives[0]

    def _tried_on(self, one: _Proof, other: ScenarioSpec) -> tuple[bool, bool]:
        """Is the other half passed by a half's certified drive? And by its expert, told this half's plate?"""
        expert, answers, told = self._planner(one.solver), one.solved.seen.answers, one.solved.seen.context
        assert told is not None
        assert told.privilege is not None
        obedient = Recorder(Prejudiced(expert.factory(), told.privilege))
        obeying = self._passes(replace(expert, factory=lambda: obedient), other)
        # Equal answers have equal results: the certified drive is driven again only where they differ.
        same = obedient.answers == answers[: len(obedient.answers)]
        return obeying if same else self._passes(_replay(answers), other), obeying

    def _reaction(self, a: _Proof, b: _Proof) -> tuple[float | None, float | None]:
        """When others first do something else, under the blind baseline's commands of the signed half, and the braking
        that would still stop it before its line then; None, None where they never do before the line.

        Of a driver who watches, where others show it sooner what the plates say. Nobody watches where the halves are
        alike to others: they can show nothing.
        """
        facts = a.blind.result.facts
        ticks = () if facts is None else facts.snapshots
        tick = self._first_difference(ticks, a.blind.seen.answers, b.spec, b.blind)
        brake = None if facts is None or tick is None else braking_before(line_point(facts.scene), tick)
        found = [] if tick is None or brake is None else [(tick.time, brake)]
        one, other = (self._loader.load(half.spec)[0] for half in (a, b))
        habits = () if alike_to_others(one, other) else drawn_habits(a.spec.pair_name)
        found += [shown for habit in habits if (shown := self.shown_to(habit, a.spec, b.spec))]
        return min(found, key=lambda shown: shown[1], default=(None, None))

    def shown_to(self, habit: Habit, signed: ScenarioSpec, contrast: ScenarioSpec) -> tuple[float, float] | None:
        """When others first do something else in the contrast half, under a watching driver's commands of the signed
        one, and the braking that would still stop it then; None where they do not before they may.
        """
        scene, _ = self._loader.load(signed)
        approach = Approach(scene.network.lane(scene.start.lane))
        showing = Showing.of(scene.convoy or scene.walkers)
        watcher = Recorder(Watcher(habit, approach))
        early: list[WorldSnapshot] = []

        def may_show(episode: Episode) -> bool:
            now = episode.snapshots[-1]
            may = showing.may(approach.to_line(now.ego), now.ego.speed)
            early[now.step :] = () if may else (now,)
            return may

        self._run_until(LoadedPlanner(habit.name, lambda: watcher), signed, may_show)
        tick = self._first_difference(early, watcher.answers, contrast)
        return None if tick is None else (tick.time, braking_to_meet(approach, showing, tick.ego))

    def _planner(self, name: str) -> LoadedPlanner:
        if name not in self._loaded:
            self._loaded[name] = replace(resolve(name), name=name)
        return self._loaded[name]

    def _first_difference(
        self,
        ticks: Sequence[WorldSnapshot],
        answers: Sequence[Control | Trajectory],
        other: ScenarioSpec,
        driven: _Drive | None = None,
    ) -> WorldSnapshot | None:
        """The first of an episode's ticks at which others do something else than when its driver's answers are given in
        the other half; None where they never do while both last. driven: an episode of the other half.
        """
        if driven is not None and driven.result.facts is not None:
            # As far as it has the same answers, the other half need not be driven again.
            for k, (tick, there) in enumerate(zip(ticks, driven.result.facts.snapshots, strict=False)):
                if k and answers[k - 1] != driven.seen.answers[k - 1]:
                    break
                if others_differ(tick, there):
                    return tick
            else:
                return None
        found: list[WorldSnapshot] = []

        def is_over(episode: Episode) -> bool:
            now = episode.snapshots[-1]
            found[:] = [one for one in ticks[now.step : now.step + 1] if others_differ(one, now)]
            return bool(found) or now.step + 1 >= len(ticks)

        self._run_until(_replay(answers), other, is_over)
        return found[0] if found else None

    def _passes(self, planner: LoadedPlanner, spec: ScenarioSpec) -> bool:
        """Does its episode get SCD? At the first event that counts against it, the answer is known."""
        result = self._run_until(planner, spec, lambda now: bool(now.judged().against))
        return result is not None and _is_passed(result)

    def breaks(self, planner: str, spec: ScenarioSpec) -> bool:
        """Does `planner` (a name or module:Class) break the rule of the row's sign? Not if its episode broke off."""
        facts = self._drive(planner, spec).result.facts
        return facts is not None and not facts.verdicts.compliant

    def _run_until(
        self, planner: LoadedPlanner, spec: ScenarioSpec, is_over: Callable[[Episode], bool]
    ) -> EpisodeResult | None:
        """An episode; None where it was broken off at a tick that `is_over`, before the planner was asked.

        The last tick is shown to `is_over`, too. Raises what the planner raises.
        """
        driver = planner.factory()
        episode = Episode(
            spec,
            planner=planner.name,
            privileged=planner.privileged,
            floor=planner.floor,
            simulation=self._simulation,
            loader=self._loader,
        )
        if episode.result is None:
            driver.reset(episode.context)
        while episode.result is None:
            if is_over(episode):
                return None
            episode.step(driver.act(episode.observation))
        if episode.result.facts is not None:
            is_over(episode)
        return episode.result

    def _drive(self, name: str, spec: ScenarioSpec) -> _Drive:
        planner = self._planner(name)
        seen = Recorder(planner.factory())
        runner = EpisodeRunner(replace(planner, factory=lambda: seen), simulation=self._simulation, loader=self._loader)
        return _Drive(runner.run(spec), seen)


def _replay(answers: Sequence[Control | Trajectory]) -> LoadedPlanner:
    return LoadedPlanner("replay", lambda: AnswerReplay(answers))


def _is_passed(result: EpisodeResult) -> bool:
    return result.facts is not None and is_scd(result.facts)


def _time(result: EpisodeResult) -> float:
    return math.nan if result.facts is None else result.facts.snapshots[-1].time


def _digest(*results: EpisodeResult) -> str:
    """SHA-256 over all places at each tick, and the verdicts on them."""
    digest = hashlib.sha256()
    for result in results:
        digest.update(f"{result.planner}|{result.outcome}|{result.error}".encode())
        if result.facts is None:
            continue
        egos = [(s.ego.x, s.ego.y, s.ego.heading, s.ego.speed) for s in result.facts.snapshots]
        digest.update(np.array(egos, dtype=np.float64).tobytes())
        for snapshot in result.facts.snapshots:
            digest.update(snapshot.actors.pose.tobytes())
        for violation in result.facts.verdicts.against:
            digest.update(violation.sentence.encode())
    return digest.hexdigest()


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
