"""Stored runs that are analysed together, of one contract and one selection, each planner once; and their traces.

`EpisodeIndex` holds the traced episodes in the order in which they deserve a place in a page.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.parquet import values_of, with_text
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import trace_path
from tsbench.metrics.aggregate import PlannerSummary, Summary, label, name_holes, summarise
from tsbench.metrics.records import Records, split_records
from tsbench.report.analyses.columns import in_published_order
from tsbench.report.compare_runs import SELECTION, differing
from tsbench.run.log.journal import Key
from tsbench.run.log.manifest import marks_of
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.log.record import SPEC_COLUMNS
from tsbench.run.options import BOTH
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import CONTRAST, HALVES, square_of
from tsbench.signs.rule_kinds import NEEDLESS


@dataclass(frozen=True)
class RunPool:
    """Runs whose planners drove the same scenarios. holes: scenarios without a record, by planner."""

    runs: tuple[StoredRun, ...]
    home: Mapping[str, StoredRun]
    holes: Mapping[str, int]

    @property
    def contract(self) -> str:
        return self.runs[0].contract

    @property
    def edition(self) -> str:
        return self.runs[0].edition

    @cached_property
    def planners(self) -> tuple[str, ...]:
        """Names of the planners that have records, in the order of the published table, others behind."""
        return in_published_order(name for name in self.home if len(self.home[name].of(name)))

    @cached_property
    def summary(self) -> Summary:
        asked = {name: run.asked[name] for name, run in self.home.items()}
        return summarise(
            self._episodes,
            contract_hash=self.contract,
            edition=self.edition,
            asked=asked,
            marks=self.marks,
            allow_partial=bool(self.holes),
        )

    @cached_property
    def marks(self) -> Mapping[str, str]:
        """What stands behind planners' names in tables, by name."""
        return {name: mark for run in self.runs for name, mark in marks_of(run.manifest).items()}

    @cached_property
    def needless(self) -> Mapping[tuple[str, str], frozenset[str]]:
        """By planner and scenario: the clauses of needless obedience that its episode has events of."""
        found: dict[tuple[str, str], set[str]] = {}
        for run in self.runs:
            events = with_text(run.violations, "clause", *NEEDLESS.clauses.split())
            for event in events.select(["planner", "scenario_id", "clause"]).to_pylist():
                found.setdefault((event["planner"], event["scenario_id"]), set()).add(event["clause"])
        return {key: frozenset(clauses) for key, clauses in found.items()}

    def failed_signed(self, planner: str) -> tuple[str, ...]:
        """Scenarios of signed halves (and of what has no pair) that a planner failed without an error outcome."""
        rows = self.home[planner].of(planner).select(["scenario_id", "half", "scd", "outcome"]).to_pylist()
        return tuple(
            row["scenario_id"]
            for row in rows
            if row["half"] != CONTRAST and not row["scd"] and not Outcome(row["outcome"]).is_error
        )

    def label(self, planner: str) -> str:
        """A planner's name as tables show it."""
        return label(planner, self.marks.get(planner, ""))

    @cached_property
    def records(self) -> dict[str, Records]:
        return split_records(self._episodes)

    @cached_property
    def summaries(self) -> tuple[PlannerSummary, ...]:
        by_name = {p.planner: p for p in self.summary.planners}
        return tuple(by_name[name] for name in self.planners)

    @property
    def selection(self) -> str:
        """Which scenarios: split, variants, which halves where not both, and whether signs were masked."""
        effective, seen = self.runs[0].manifest["effective"], self.runs[0].perception
        half = effective.get("half", BOTH)
        halves = "" if half == BOTH else f", {half} halves"
        masked = ", signs masked" if seen.masked else ""
        eyes = "" if seen.level is None else f", perception {seen.level.name}"
        city = f"{effective['city']}, " if "city" in effective else ""
        return f"{city}{effective['split']} split, variants {effective['variants']}{halves}{masked}{eyes}"

    def title(self, what: str) -> str:
        """What is shown, of what; where records are missing that comes first."""
        warning, _, rest = self.summary.title.rpartition(": ")
        text = f"{what}: {rest}, {self.selection}"
        return f"{warning}: {text}" if warning else text

    @property
    def _episodes(self) -> pa.Table:
        return pa.concat_tables([run.episodes for run in self.runs])


def read_pool(paths: Sequence[Path], allow_partial: bool, *, under_way: bool = False) -> RunPool:
    """Read and check runs. Raises InputError: unreadable runs, and all that `make_pool` refuses.

    under_way: as for `read_run`.
    """
    return make_pool([read_run(path, under_way=under_way) for path in paths], allow_partial)


def make_pool(runs: Sequence[StoredRun], allow_partial: bool) -> RunPool:
    """Put runs together.

    Raises InputError: different contracts or selections, signs masked in some only, a planner twice, and without
    `allow_partial` scenarios that have no record.
    """
    first = runs[0]
    home: dict[str, StoredRun] = {}
    for run in runs:
        check_contract(first, run)
        _check_selection(first, run)
        for name in run.asked:
            if name in home:
                raise InputError(f"planner {name} is in {home[name].path} and in {run.path}: give it once only")
            home[name] = run
    holes = {name: k for name, run in home.items() if (k := run.holes(name))}
    name_holes(holes, {name: run.asked[name] for name, run in home.items()}, allow_partial)
    pool = RunPool(tuple(runs), home, holes)
    if not pool.planners:
        raise InputError(f"{', '.join(str(run.path) for run in runs)}: no episode is finished yet")
    return pool


def check_contract(a: StoredRun, b: StoredRun) -> None:
    if a.contract != b.contract:
        raise InputError(
            f"{a.path} has contract {a.contract}, {b.path} has {b.contract}: rules, scenes or versions differ, "
            "so their scores do not belong into one table"
        )


def _check_selection(a: StoredRun, b: StoredRun) -> None:
    for key, (x, y) in differing(a, b, SELECTION).items():
        told = f"{x}, {y}" if key != "types" else "some, others"
        raise InputError(
            f"{a.path} and {b.path} have different scenarios ({key}: {told}): "
            "analyse runs of the same selection together"
        )
    if a.perception.masked != b.perception.masked:
        raise InputError(
            f"signs are masked in one of {a.path} and {b.path} only: tsbench analyse ablation compares such runs"
        )
    if a.perception != b.perception:
        raise InputError(
            f"{a.path} and {b.path} are of different perception levels: tsbench analyse perception compares such runs"
        )


# Which halves of a pair were passed, by whether the signed and the contrast half was.
PASSES = {(True, True): "both", (True, False): "only signed", (False, True): "only contrast", (False, False): "none"}
# Columns of a record that reports show and players need.
_VIOLATION = ("sign_compliant", "scd", "violation_clause", "violation_time_s")
_INDEXED = ("planner", *SPEC_COLUMNS, "outcome", "error", *_VIOLATION, "driving_score")
Row = Mapping[str, Any]


@dataclass(frozen=True)
class EpisodeIndex:
    """Episodes of a pool. data: what they are of; columns: of their records, by planner and scenario (records as
    dictionaries take three times the memory); traced: rows with a trace, in order; notes: what is odd.

    homes: the folder of each planner's run; stories: of runs. beside: by row number the rows of its pair or square,
    itself among them, by their ids; passes: by row number which halves of its pair were passed, one of PASSES.
    """

    data: DataSet
    columns: Mapping[str, Sequence[Any]]
    homes: Mapping[str, Path]
    stories: Mapping[Key, Row]
    traced: tuple[int, ...]
    notes: tuple[str, ...]
    beside: Mapping[int, tuple[int, ...]]
    passes: Mapping[int, str]

    def __len__(self) -> int:
        return len(self.columns["planner"])

    def key(self, row: int) -> Key:
        return self.columns["planner"][row], self.columns["scenario_id"][row]

    def trace(self, row: int) -> Path:
        """Where the trace of an episode is, or will be when it is driven again."""
        return trace_path(self.homes[self.columns["planner"][row]], *self.key(row))

    @cached_property
    def within_reach(self) -> set[int]:
        """Rows with a trace, and of failures among them the rest of their pairs, which can be driven again."""
        failed = [row for row in self.traced if not self.columns["scd"][row]]
        return {*self.traced, *(other for row in failed for other in self.beside.get(row, ()))}


def index_episodes(pool: RunPool) -> EpisodeIndex:
    """Look for the traces of a pool's episodes. Raises InputError for a table that cannot be read."""
    stored = {name: [v for run in pool.runs for v in values_of(run.episodes[name])] for name in _INDEXED}
    place = {name: k for k, name in enumerate(pool.planners)}
    keys = list(zip((place[name] for name in stored["planner"]), stored["scenario_id"], strict=True))
    order = sorted(range(len(keys)), key=keys.__getitem__)
    columns = {name: [values[k] for k in order] for name, values in stored.items()}
    stories = {key: story for run in pool.runs for key, story in run.stories.items()}
    numbers = {key: k for k, key in enumerate(zip(columns["planner"], columns["scenario_id"], strict=True))}
    homes = {name: run.path for name, run in pool.home.items()}
    there = []
    notes = []
    for run in pool.runs:
        found = [p for p in sorted((run.path / "traces").rglob("*.parquet")) if not p.name.startswith(".")]
        strays = []
        for path in found:
            key = unquote(path.parent.name), unquote(path.stem)
            if key in numbers and path == trace_path(homes[key[0]], *key):
                there.append(numbers[key])
            else:
                strays.append(path)
        if strays:
            names = ", ".join(str(path.relative_to(run.path)) for path in strays[:3])
            more = "" if len(strays) <= 3 else f" and {len(strays) - 3} more"
            notes.append(f"{run.path}: {len(strays)} traces without their episode, not shown: {names}{more}")
    traced, data = tuple(sorted(there)), pool.runs[0].data
    return EpisodeIndex(data, columns, homes, stories, traced, tuple(notes), *_pairs(columns))


def _pairs(columns: Mapping[str, Sequence[Any]]) -> tuple[dict[int, tuple[int, ...]], dict[int, str]]:
    """What is beside the rows of pairs, and passes of those whose other half is there too."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    squares: dict[tuple[str, str], list[int]] = {}
    named = zip(*(columns[name] for name in ("planner", "pair_id", "half")), strict=True)
    for k, (planner, pair_id, half) in enumerate(named):
        if pair_id:
            found.setdefault((planner, pair_id), {})[half] = k
            squares.setdefault((planner, square_of(pair_id)), []).append(k)
    scd = columns["scd"]
    passes: dict[int, str] = {}
    for pair in (pair for pair in found.values() if len(pair) == len(HALVES)):
        signed, contrast = (pair[half] for half in HALVES)
        passes |= dict.fromkeys((signed, contrast), PASSES[scd[signed], scd[contrast]])
    ids = columns["scenario_id"]
    together = (tuple(sorted(rows, key=ids.__getitem__)) for rows in squares.values())
    return {row: rows for rows in together for row in rows}, passes


def by_interest(index: EpisodeIndex) -> list[int]:
    """Rows within reach: violations first, then other failures, then the rest; planners and types in turn in each.

    The other rows of a pair or square follow at once, for they are played together.
    """
    classes: dict[int, dict[tuple[str, str], list[int]]] = {0: {}, 1: {}, 2: {}}
    column = index.columns
    for row in index.traced:
        rank = 0 if column["violation_clause"][row] else 1 if not column["scd"][row] else 2
        classes[rank].setdefault((column["scenario_type"][row], column["planner"][row]), []).append(row)
    turns = (zip_longest(*(queues[name] for name in sorted(queues))) for queues in classes.values())
    alone = [row for turn in turns for places in turn for row in places if row is not None]
    halves = (half for row in alone for half in (row, *index.beside.get(row, ())))
    return [row for row in dict.fromkeys(halves) if row in index.within_reach]
