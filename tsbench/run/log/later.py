"""What the planners of a run opened and left in episodes: which files the run knows them by, and may they remember?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.paths import expanded
from tsbench.run import opened_files
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo, check_unchanged, files_place


@dataclass
class _Told:
    """place: where the planner's files lie. opened: lines of `opened_files.hashes` by name; left: as in records."""

    place: Path | None
    opened: dict[str, str] = field(default_factory=dict)
    left: dict[str, None] = field(default_factory=dict)


class Later:
    """Of each planner the files that its episodes have read, and what they have left outside their processes."""

    def __init__(self, planners: Sequence[PlannerInfo]) -> None:
        self._planners = {planner.name: planner for planner in planners}
        self._told: dict[str, _Told] = {}

    def take(self, planner: str, opened: Iterable[str], left: Iterable[str]) -> None:
        """Add what stands in a line of the journal or in a manifest."""
        opened, left = list(opened), list(left)
        if opened or left:
            told = self._of(planner)
            told.opened.update((line.partition("  ")[2], line) for line in opened)
            told.left.update(dict.fromkeys(left))

    def take_all(self, entries: Iterable[Mapping[str, Any]]) -> None:
        for entry in entries:
            if entry["planner"] in self._planners:
                self.take(entry["planner"], entry["opened"], entry["left"])

    def hashed(self, record: Record) -> Record:
        """A record with hashes for the names of the files that were opened; they are computed once in a run."""
        if not (record.opened or record.left):
            return record
        name = record.row["planner"]
        told = self._of(name)
        new = {one: told.place / expanded(one) if told.place else expanded(one) for one in record.opened}
        unknown = [str(path) for one, path in new.items() if one not in told.opened]
        found = opened_files.hashes(unknown, told.place)
        self.take(name, found, record.left)
        return replace(record, opened=tuple(told.opened[one] for one in record.opened if one in told.opened))

    def told(self) -> list[dict[str, Any]]:
        """As it stands in a manifest."""
        return [
            {"planner": name, "opened": sorted(told.opened.values()), "left": sorted(told.left)}
            for name, told in sorted(self._told.items())
        ]

    def check(self) -> None:
        """Raises InputError where a file that was read is another now; what the planner wrote by itself may be."""
        for name, told in self._told.items():
            wrote = {expanded(text.partition(" ")[2]) for text in told.left}
            place = told.place or Path()
            kept = tuple(line for one, line in told.opened.items() if place / expanded(one) not in wrote)
            check_unchanged(replace(self._planners[name], code_sha256=None, opened=kept), None, told.place)

    def _of(self, planner: str) -> _Told:
        if planner not in self._told:
            try:
                place = files_place(self._planners[planner].spec)
            except InputError:
                place = None
            self._told[planner] = _Told(place)
        return self._told[planner]
