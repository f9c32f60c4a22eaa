"""What the builder of scenes asks of a draw: its certificate, and whether a driver who should break the rule does."""

from __future__ import annotations

from tsbench.dataset.certify.certifier import Certifier
from tsbench.scenarios.spec import ScenarioSpec


class RejectionTest(Certifier):
    """A certifier that also sees through drivers who are no part of a proof. Runs in the process's one simulation."""

    def breaks(self, planner: str, spec: ScenarioSpec) -> bool:
        """Does `planner` (a name or module:Class) break the rule of the row's sign? Not if its episode broke off."""
        facts = self._drive(planner, spec).result.facts
        return facts is not None and not facts.target.compliant
