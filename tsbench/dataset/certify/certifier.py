"""Drives a scenario row and says what that proves. Source: docs/spec/scenes.md, "Certification"."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tsbench.dataset.certify.fingerprint import driving_fingerprint
from tsbench.dataset.certify.pair import (
    Recorder,
    Replay,
    braking_before,
    first_difference,
)
from tsbench.dataset.certify.sanity import arrival_gap, overlapping_pairs, road_users
from tsbench.episode.result import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.metrics.episode import passed
from tsbench.planners.base import Control, Trajectory
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.certificates import Certificate, bases
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.signs.catalog import load_catalog
from tsbench.sim.sumo import Simulation

# In the order in which they are asked; the first that solves a row stands in its certificate.
EXPERTS = ("idm-e", "idm-s3-e", "idm-s4-e")


@dataclass(frozen=True)
class _Proof:
    """One half as it was proven: the expert's answers, the tempted driver's episode, and its first view's digest."""

    spec: ScenarioSpec
    answers: Sequence[Control | Trajectory]
    blind: EpisodeResult
    view: str


class Certifier:
    """Proves rows in the process's one simulation. loader: gives their scenes."""

    def __init__(self, simulation: Simulation, loader: SceneLoader) -> None:
        self._simulation, self._loader = simulation, loader
        self._catalog = load_catalog()
        self._runners: dict[str, tuple[EpisodeRunner, list[Recorder]]] = {}
        self._proofs: dict[str, _Proof] = {}
        self._last = Recorder(Replay(()), True)

    def prove(
        self, spec: ScenarioSpec, tempted: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        """The certificate of a row. tempted: the sign-blind driver's name. asked, realised: cars per lane-km."""
        solver, solved = self._solve(spec)
        answers = self._last.answers
        blind = self._drive(tempted, spec)
        self._proofs[spec.half] = _Proof(spec, answers, blind, self._last.view)
        facts, calm = blind.facts, solved.facts
        return Certificate(
            scenario_id=spec.scenario_id, scenario_type=spec.scenario_type, split=spec.split, attempt=attempt,
            expert=solver, expert_time_s=_time(solved) if solver else math.nan, tempted=tempted,
            tempted_outcome=blind.outcome.value, tempting=not _scd(blind),
            engaged=facts is not None and facts.target.engaged, asked_density=asked, realised_density=realised,
            road_users=0 if facts is None else road_users(facts),
            overlaps=0 if calm is None else overlapping_pairs(calm),
            arrival_gap_s=math.nan if facts is None else arrival_gap(facts), error=solved.error or blind.error,
            digest=_digest(solved, blind), basis=bases([spec], self._catalog)[spec.scenario_id],
            code=driving_fingerprint(), reproduced=None,
        )  # fmt: skip

    def prove_pair(self, signed: Certificate, contrast: Certificate) -> tuple[Certificate, Certificate]:
        """Both with what is known of the pair. Raises ValueError unless its rows were the last two that were proven."""
        a, b = self._proofs[SIGNED], self._proofs[CONTRAST]
        if (a.spec.scenario_id, b.spec.scenario_id) != (signed.scenario_id, contrast.scenario_id):
            raise ValueError(f"{signed.scenario_id} and {contrast.scenario_id} were not proven last")
        passed = [_scd(self._replay(one.answers, other.spec)) for one, other in ((a, b), (b, a))]
        tick = brake = None
        if a.blind.facts is not None and b.blind.facts is not None:
            tick = first_difference(a.blind.facts, b.blind.facts)
            brake = None if tick is None else braking_before(a.blind.facts.scene.target_sign, tick)
        pair = partial(
            replace, exclusive=not any(passed), blind_equal=a.view == b.view != "",
            differs_s=None if brake is None or tick is None else tick.time, brake_mps2=brake,
        )  # fmt: skip
        return pair(signed), pair(contrast)

    def again(self, spec: ScenarioSpec, old: Certificate) -> Certificate:
        """The row driven once more; `reproduced` where it shows the same, whatever code drove it before, and where.

        What only the builder measures (attempt, densities) is kept.
        """
        new = self.prove(spec, old.tempted, old.attempt, old.asked_density, old.realised_density)
        return replace(new, reproduced=not old.differences(new))

    def _solve(self, spec: ScenarioSpec) -> tuple[str, EpisodeResult]:
        """The first expert that gets SCD and its episode; "" and the first expert's episode if none does."""
        results = []
        for name in EXPERTS:
            results.append(self._drive(name, spec))
            if _scd(results[-1]):
                return name, results[-1]
        return "", results[0]

    def _drive(self, planner: str, spec: ScenarioSpec) -> EpisodeResult:
        if planner not in self._runners:
            loaded, made = resolve(planner), list[Recorder]()

            def factory() -> Recorder:
                made.append(Recorder(loaded.factory(), not loaded.privileged))
                return made[-1]

            runner = EpisodeRunner(
                replace(loaded, name=planner, factory=factory),
                simulation=self._simulation,
                loader=self._loader,
            )
            self._runners[planner] = runner, made
        runner, made = self._runners[planner]
        result = runner.run(spec)
        self._last = made[-1] if made else Recorder(Replay(()), True)
        return result

    def _replay(self, answers: Sequence[Control | Trajectory], spec: ScenarioSpec) -> EpisodeResult:
        planner = LoadedPlanner("replay", lambda: Replay(answers), False)
        return EpisodeRunner(planner, simulation=self._simulation, loader=self._loader).run(spec)


def _scd(result: EpisodeResult) -> bool:
    return result.facts is not None and passed(result.facts)


def _time(result: EpisodeResult) -> float:
    return math.nan if result.facts is None else result.facts.snapshots[-1].time


def _digest(*results: EpisodeResult) -> str:
    """SHA-256 over where everybody was at each tick, and what was made of it."""
    digest = hashlib.sha256()
    for result in results:
        digest.update(f"{result.planner}|{result.outcome}|{result.error}".encode())
        if result.facts is None:
            continue
        egos = [(s.ego.x, s.ego.y, s.ego.heading, s.ego.speed) for s in result.facts.snapshots]
        digest.update(np.array(egos, dtype=np.float64).tobytes())
        for snapshot in result.facts.snapshots:
            digest.update(snapshot.actors.pose.tobytes())
        for violation in (*result.facts.target.violations, *result.facts.needless):
            digest.update(violation.sentence.encode())
    return digest.hexdigest()
