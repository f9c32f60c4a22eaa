"""`codes`: reads what is on plates and relates it to nothing. Source: docs/floor.md."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.floor.blind import Blind

# A code and what it posts, km/h (None: nothing).
Plate = tuple[str, float | None]


class Codes(Blind):
    """`blind` where the plates in sight stand more often in signed halves, `idm` where in contrast halves.

    It asks only which codes and values are there, not for which lane, arm, direction or way they hold. It is `blind` as
    long as a plate in sight has not faced it: the codes of some alone would say which of them face it.
    obeys: what it made of them, None as long as no plate is in sight, or not all are read.
    """

    sign_access = True
    obeys: bool | None = None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""
        super().reset(context)
        self.obeys = None

    def act(self, observation: Observation) -> Control:
        """The command of the driver that the first plates in sight call for."""
        plates = [(s.code, s.value) for s in observation.signs]
        if self.obeys is None and plates and all(code for code, _ in plates):
            self.obeys = signed_odds(plates, counts()) > 0.0
            if not self.obeys:
                self._habit = RuleConstraint()
        return super().act(observation)


def signed_odds(plates: Iterable[Plate], counted: Mapping[Plate, tuple[int, int]]) -> float:
    """Log odds that a row with these plates is a signed half: naive Bayes with add-one smoothing."""
    return sum(math.log((s + 1) / (c + 1)) for s, c in (counted.get(p, (0, 0)) for p in sorted(set(plates), key=str)))


@cache
def counts() -> Mapping[Plate, tuple[int, int]]:
    """In how many signed and contrast halves of the train split each plate stands (`tsbench train codes`)."""
    return read_counts(Path(__file__).with_name("codes.csv"))


def read_counts(path: Path) -> Mapping[Plate, tuple[int, int]]:
    """The counts of a file with the columns code, value (km/h, empty for none), signed, contrast."""
    with path.open(encoding="utf-8", newline="") as file:
        return {
            (r["code"], float(r["value"]) if r["value"] else None): (int(r["signed"]), int(r["contrast"]))
            for r in csv.DictReader(file)
        }
