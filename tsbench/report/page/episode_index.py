"""Which episodes of some runs can be played: their traces, in the order in which they deserve a place in a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from tsbench.episode.trace import trace_path
from tsbench.report.analyses.pool import RunPool
from tsbench.scenarios.spec import HALVES

# Which halves of a pair were passed, by whether the signed and the contrast half was.
PASSES = {
    (True, True): "both", (True, False): "only signed", (False, True): "only contrast", (False, False): "none",
}  # fmt: skip
Key = tuple[str, str]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class EpisodeIndex:
    """Episodes of a pool. rows: records, by planner and scenario; traces: by row number; notes: what is odd.

    stories: of the first event that counts against SCD, with its unit. partners: by row number that of the other half;
    passes: by row number which halves of its pair were passed, one of PASSES.
    """

    rows: Sequence[Row]
    stories: Mapping[Key, Row]
    traces: Mapping[int, Path]
    notes: tuple[str, ...]
    partners: Mapping[int, int]
    passes: Mapping[int, str]

    def key(self, row: int) -> Key:
        return self.rows[row]["planner"], self.rows[row]["scenario_id"]


def index_episodes(pool: RunPool) -> EpisodeIndex:
    """Look for the traces of a pool's episodes. Raises InputError for a table that cannot be read."""
    rows: list[Row] = [row for run in pool.runs for row in run.episodes.to_pylist()]
    place = {name: k for k, name in enumerate(pool.planners)}
    rows.sort(key=lambda row: (place[row["planner"]], row["scenario_id"]))
    stories: dict[Key, Row] = {}
    for run in pool.runs:
        for event in run.violations.to_pylist():
            if event["target"]:
                stories.setdefault((event["planner"], event["scenario_id"]), event)
    expected = {
        trace_path(pool.home[row["planner"]].path, row["planner"], row["scenario_id"]): k
        for k, row in enumerate(rows)
    }
    there: dict[int, Path] = {}
    notes = []
    for run in pool.runs:
        found = [p for p in sorted((run.path / "traces").rglob("*.parquet")) if not p.name.startswith(".")]
        there |= {expected[path]: path for path in found if path in expected}
        strays = [path for path in found if path not in expected]
        if strays:
            names = ", ".join(str(path.relative_to(run.path)) for path in strays[:3])
            more = "" if len(strays) <= 3 else f" and {len(strays) - 3} more"
            notes.append(f"{run.path}: {len(strays)} traces without their episode, not shown: {names}{more}")
    return EpisodeIndex(rows, stories, dict(sorted(there.items())), tuple(notes), *_pairs(rows))


def _pairs(rows: Sequence[Row]) -> tuple[dict[int, int], dict[int, str]]:
    """Partners and passes of the rows whose other half is there too."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for k, row in enumerate(rows):
        if row["pair_id"]:
            found.setdefault((row["planner"], row["pair_id"]), {})[row["half"]] = k
    partners: dict[int, int] = {}
    passes: dict[int, str] = {}
    for pair in (pair for pair in found.values() if len(pair) == len(HALVES)):
        signed, contrast = (pair[half] for half in HALVES)
        partners |= {signed: contrast, contrast: signed}
        passes |= dict.fromkeys((signed, contrast), PASSES[rows[signed]["scd"], rows[contrast]["scd"]])
    return partners, passes


def by_interest(index: EpisodeIndex) -> list[int]:
    """Rows with a trace: violations first, then other failures, then the rest; planners and types in turn in each.

    The other half of a pair follows at once, for the two are played together.
    """
    classes: dict[int, dict[tuple[str, str], list[int]]] = {0: {}, 1: {}, 2: {}}
    for row in index.traces:
        record = index.rows[row]
        rank = 0 if record["violation_clause"] else 1 if not record["scd"] else 2
        classes[rank].setdefault((record["scenario_type"], record["planner"]), []).append(row)
    alone = [row for queues in classes.values() for row in _in_turn(queues)]
    halves = (half for row in alone for half in (row, index.partners.get(row, row)))
    return [row for row in dict.fromkeys(halves) if row in index.traces]


def _in_turn(queues: Mapping[tuple[str, str], list[int]]) -> Iterator[int]:
    for places in zip_longest(*(queues[name] for name in sorted(queues))):
        yield from (row for row in places if row is not None)
