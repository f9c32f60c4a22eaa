"""Drives a scenario row and says what that proves. Source: docs/spec/scenes.md, "Certification"."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace

import numpy as np

from tsbench.dataset.certify.fingerprint import driving_fingerprint
from tsbench.dataset.certify.sanity import arrival_gap, overlapping_pairs, road_users
from tsbench.episode.outcome import Outcome
from tsbench.episode.result import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.registry import resolve
from tsbench.scenarios.certificates import Certificate, bases
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import load_catalog
from tsbench.sim.sumo import Simulation

# In the order in which they are asked; the first that solves a row stands in its certificate.
EXPERTS = ("idm-e", "idm-s3-e", "idm-s4-e")


class Certifier:
    """Proves rows in the process's one simulation. loader: gives their scenes."""

    def __init__(self, simulation: Simulation, loader: SceneLoader) -> None:
        self._simulation, self._loader = simulation, loader
        self._catalog = load_catalog()
        self._runners: dict[str, EpisodeRunner] = {}

    def prove(
        self, spec: ScenarioSpec, tempted: str, attempt: int, asked: float, realised: float
    ) -> Certificate:
        """The certificate of a row. tempted: the sign-blind driver's name. asked, realised: cars per lane-km."""
        solver, solved = self._solve(spec)
        blind = self._drive(tempted, spec)
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

    def again(self, spec: ScenarioSpec, old: Certificate) -> Certificate:
        """The row driven once more; `reproduced` where it shows the same, whatever code drove it before, and where.

        What only the builder measures (attempt, densities) is kept.
        """
        new = self.prove(spec, old.tempted, old.attempt, old.asked_density, old.realised_density)
        return replace(new, reproduced=not old.differences(new))

    def _solve(self, spec: ScenarioSpec) -> tuple[str, EpisodeResult]:
        """The first expert that gets SCD and its episode; "" and the first expert's episode if none does."""
        first: EpisodeResult | None = None
        for name in EXPERTS:
            result = self._drive(name, spec)
            if _scd(result):
                return name, result
            first = first or result
        assert first is not None
        return "", first

    def _drive(self, planner: str, spec: ScenarioSpec) -> EpisodeResult:
        runner = self._runners.get(planner)
        if runner is None:
            runner = EpisodeRunner(
                replace(resolve(planner), name=planner), simulation=self._simulation, loader=self._loader
            )
            self._runners[planner] = runner
        return runner.run(spec)


def _scd(result: EpisodeResult) -> bool:
    facts = result.facts
    return facts is not None and result.outcome is Outcome.ARRIVED and facts.target.compliant


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
        for violation in result.facts.target.violations:
            digest.update(violation.sentence.encode())
    return digest.hexdigest()
