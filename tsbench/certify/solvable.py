"""Can a scene be solved? The privileged expert drives it. Source: spec/scenes.md, "Certification" (solvable)."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.metrics.outcome import Outcome
from tsbench.run.episode import EpisodeRunner
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

EXPERT = "idm-e"


class Prover:
    """Drives scenes with the expert, in the process's one simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self._runner = EpisodeRunner(EXPERT, EXPERT, simulation=simulation)

    def solved(self, rows: Sequence[ScenarioSpec]) -> list[bool]:
        """For each row: did the expert arrive without a violation of the target rule?"""
        return [self._solves(row) for row in rows]

    def _solves(self, row: ScenarioSpec) -> bool:
        result = self._runner.run(row)
        return (
            result.facts is not None and result.outcome is Outcome.ARRIVED and result.facts.target.compliant
        )
