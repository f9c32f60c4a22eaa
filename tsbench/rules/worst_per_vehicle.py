"""Of all that one vehicle suffers in one passage of the ego, the gravest alone is an event."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.rules.events import EventLog
from tsbench.sim.world import WorldSnapshot


class _Offence:
    """One clause against one vehicle: its ticks, and the value that is farthest beyond the threshold."""

    def __init__(self, start: WorldSnapshot, value: float, threshold: float) -> None:
        self.start, self.end, self.value, self.threshold = start, start, value, threshold
        self.steps: list[int] = []

    def add(self, snapshot: WorldSnapshot, value: float) -> None:
        """One more tick."""
        self.end = snapshot
        self.steps.append(snapshot.step)
        if abs(value - self.threshold) > abs(self.value - self.threshold):
            self.value = value


class WorstPerVehicle:
    """Collects the ticks at which clauses were broken. clauses: the gravest first."""

    def __init__(self, log: EventLog, clauses: Sequence[str]) -> None:
        self._log, self._clauses = log, clauses
        self._found: dict[int, dict[str, _Offence]] = {}

    def note(self, row: int, clause: str, snapshot: WorldSnapshot, value: float, threshold: float) -> None:
        """A clause is broken at this tick against the road user of a row."""
        offences = self._found.setdefault(row, {})
        if clause not in offences:
            offences[clause] = _Offence(snapshot, value, threshold)
        offences[clause].add(snapshot, value)

    def close(self) -> None:
        """Enter one event for each road user."""
        for row, offences in self._found.items():
            clause = next(c for c in self._clauses if c in offences)
            found = offences[clause]
            other = found.start.actors.table.ids[row]
            self._log.event(clause, found.start, found.end.time, found.value, found.threshold, other)
            for step in found.steps:
                self._log.mark(step)
        self._found = {}
