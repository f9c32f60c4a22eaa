"""`tsbench compare`: two sides of stored runs, matched scenario by scenario, or refused with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from tsbench.core.errors import InputError
from tsbench.metrics.compare import Comparison, compare
from tsbench.run.log.read import StoredRun, is_run, read_run

# What of a run's options chooses its scenarios, and what else may explain a difference.
SELECTION = ("split", "types", "variants", "limit", "scenarios")
_EXPLAINS = ("mask_signs", "device")


@dataclass(frozen=True)
class Side:
    """One planner of one run."""

    run: StoredRun
    planner: str

    @property
    def label(self) -> str:
        """Planner and folder."""
        return f"{self.planner} ({self.run.path})"


@dataclass(frozen=True)
class Matched:
    """A comparison with what must be said beside it.

    warnings: why the figures are not plain ones, part of the title; notes: other things in which the runs differ.
    contracts: of A and of B.
    """

    a: Side
    b: Side
    comparison: Comparison
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    contracts: tuple[str, str]

    @property
    def title(self) -> str:
        """One line: warnings first."""
        text = f"A {self.a.label}, B {self.b.label}: {self.comparison.pairs} paired scenarios"
        return ": ".join(("; ".join(self.warnings), text)) if self.warnings else text


def compare_runs(text_a: str, text_b: str, *, force: bool, allow_partial: bool) -> Matched:
    """Compare `RUN[:planner]` with `RUN[:planner]`.

    Raises InputError: unreadable runs, an unclear planner; without `allow_partial` holes; without `force` different
    contracts or different scenarios.
    """
    a, b = find_side(text_a), find_side(text_b)
    warnings = [*_contracts(a.run, b.run, force)]
    partial = _holes(a, b, allow_partial)
    left, right = a.run.of(a.planner), b.run.of(b.planner)
    common = sorted(_scenarios(left) & _scenarios(right))
    warnings += _selections(a, b, len(left), len(right), len(common), force, bool(partial))
    if not common:
        raise InputError(f"{text_a} and {text_b} have no scenario in common: nothing to compare")
    left, right = (table.filter(pc.is_in(table["scenario_id"], pa.array(common))) for table in (left, right))
    contracts = a.run.contract, b.run.contract
    comparison = compare(left, right, seed="\n".join(sorted(set(contracts))))
    return Matched(a, b, comparison, (*partial, *warnings), _notes(a.run, b.run), contracts)


def find_side(text: str) -> Side:
    """`RUN` of a run with one planner, or `RUN:planner`. Both may hold colons: the first run found counts."""
    places = [(text, None), *((text[:k], text[k + 1 :]) for k, c in enumerate(text) if c == ":" and k)]
    for path, planner in places:
        if not is_run(Path(path)):
            continue
        run = read_run(Path(path))
        names = ", ".join(run.asked)
        if planner is None:
            if len(run.asked) != 1:
                raise InputError(f"{path}: has planners {names}: name one, as {path}:{next(iter(run.asked))}")
            return Side(run, next(iter(run.asked)))
        if planner not in run.asked:
            raise InputError(f"{path}: has no planner {planner!r}, only {names}")
        return Side(run, planner)
    raise InputError(f"{text}: no run folder (expected RUN or RUN:planner, with RUN/run.json)")


def _scenarios(table: pa.Table) -> set[str]:
    return {str(name) for name in table["scenario_id"].to_pylist()}


def _contracts(a: StoredRun, b: StoredRun, force: bool) -> list[str]:
    if a.contract == b.contract:
        return []
    if not force:
        raise InputError(
            f"{a.path} has contract {a.contract}, {b.path} has {b.contract}: rules, scenes or versions differ, "
            "so their scores are not comparable; --force compares them all the same and says so"
        )
    return [f"FORCED, contracts differ (A {a.contract[:12]}, B {b.contract[:12]})"]


def _holes(a: Side, b: Side, allow_partial: bool) -> list[str]:
    holes = {side.label: side.run.holes(side.planner) for side in (a, b)}
    named = ", ".join(f"{label}: {k}" for label, k in holes.items() if k)
    if named and not allow_partial:
        raise InputError(f"scenarios without a record ({named}): continue the run, or pass --allow-partial")
    return [f"PARTIAL, scenarios without a record ({named})"] if named else []


def _selections(a: Side, b: Side, n_a: int, n_b: int, common: int, force: bool, partial: bool) -> list[str]:
    """Holes may explain different scenarios, but only of runs that were asked for the same ones."""
    if n_a == n_b == common:
        return []
    first, second = (side.run.manifest["effective"] for side in (a, b))
    same = all(first.get(key) == second.get(key) for key in SELECTION)
    if partial and same and a.run.contract == b.run.contract:
        return []
    counts = f"A has {n_a}, B has {n_b}, {common} in common"
    if not force:
        raise InputError(
            f"the runs have different scenarios ({counts}): --force compares the common ones and says so"
        )
    return [f"FORCED, different scenarios ({counts})"]


def _notes(a: StoredRun, b: StoredRun) -> tuple[str, ...]:
    first, second = a.manifest["effective"], b.manifest["effective"]
    return tuple(
        f"{key}: A {first.get(key)}, B {second.get(key)}"
        for key in _EXPLAINS
        if first.get(key) != second.get(key)
    )
