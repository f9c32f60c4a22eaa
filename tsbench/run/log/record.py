"""Records: one episode as flat dictionaries of primitives, ready for JSON and for Arrow.

First the columns of a run's three tables, with their types and whether they may be null.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa

from tsbench.core.parquet import columns
from tsbench.core.text import one_line
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult, Outcome
from tsbench.metrics.episode_metrics import EPISODE_METRICS, episode_metrics
from tsbench.metrics.scd import SCD
from tsbench.rules.monitor import Violation
from tsbench.scenarios.spec import SIGNED, ScenarioSpec

SCHEMA_VERSION = 1
# Columns of the scenario row that older runs lack, with what they stand for there.
LATER = {"pair_id": "", "half": SIGNED, "place": ""}

_TEXT, _FLAG, _REAL, _COUNT, _LONG = pa.string(), pa.bool_(), pa.float64(), pa.int32(), pa.int64()
_KINDS: dict[type, pa.DataType] = {str: _TEXT, bool: _FLAG, float: _REAL, int: _COUNT}
_must, _may = columns, partial(columns, nullable=True)

EPISODES = pa.schema(
    [
        *_must(_TEXT, "planner", "scenario_id", "scenario_type", "group", "sign_code"),
        *_may(_REAL, "sign_value"),
        *_must(_TEXT, "map_id", "family", "shape", "slot"),
        *_must(_COUNT, "variant"),
        *_must(_TEXT, "split"),
        *_must(_LONG, "seed"),
        *_must(_TEXT, *LATER),
        *_must(_FLAG, "privileged"),
        *_must(_TEXT, "outcome"),
        *_may(_TEXT, "error"),
        *(pa.field(m.column, _KINDS[m.kind], nullable=m is not SCD) for m in EPISODE_METRICS),
    ]
)

VIOLATIONS = pa.schema(
    [
        *_must(_TEXT, "planner", "scenario_id"),
        *_must(_COUNT, "number"),
        *_must(_FLAG, "target"),
        *_must(_TEXT, "rule", "clause", "sign_id", "sign_code"),
        *_must(_REAL, "start_s", "end_s", "x", "y", "heading", "speed"),
        *_must(_REAL, "value", "threshold", "margin"),
        *_must(_TEXT, "unit"),
        *_may(_TEXT, "other"),
        *_must(_TEXT, "sentence"),
    ]
)

TIMING = pa.schema(
    [
        *_must(_TEXT, "planner", "scenario_id"),
        *_may(_COUNT, "ticks"),
        *_may(_REAL, "start_s", "sim_s", "planner_s", "planner_mean_s", "planner_p95_s", "planner_max_s"),
        *_must(_REAL, "total_s"),
    ]
)

TABLES = {"episodes.parquet": EPISODES, "violations.parquet": VIOLATIONS, "timing.parquet": TIMING}


Row = dict[str, Any]

# Columns that are copied from the scenario row.
SPEC_COLUMNS = (
    "scenario_id", "scenario_type", "group", "sign_code", "sign_value", "map_id", "family", "shape", "slot",
    "variant", "split", "seed", "pair_id", "half", "place",
)  # fmt: skip
_STORY_CHARS = 1 << 16
_SHOWN_TICKS = 30


@dataclass(frozen=True)
class Record:
    """All that is kept of one episode besides its trace.

    row: columns of `episodes.parquet`; events: rows of `violations.parquet`; timing: of `timing.parquet`.
    detail: text for `errors/`, "" where there was no error. trace_sha256: of the trace (hex), None where none was
    kept. opened: names of files that the planner read in the episode; left: what it left outside its process, by which
    it may remember (`run.opened_files`).
    """

    row: Row
    events: list[Row]
    timing: Row
    detail: str
    trace_sha256: str | None = None
    opened: tuple[str, ...] = ()
    left: tuple[str, ...] = ()


def same_value(a: Any, b: Any) -> bool:
    """Do two records agree in a value? Two NaN do."""
    return bool(a == b) or (a != a and b != b)


def error_row(spec: ScenarioSpec, planner: str, privileged: bool, outcome: Outcome, error: str) -> Row:
    """A row without figures: what did not happen is null, never zero; as a success it counts as none."""
    row = head_row(spec, planner, privileged, outcome, one_line(error) or "no cause given")
    row.update({metric.column: False if metric is SCD else None for metric in EPISODE_METRICS})
    return row


def make_timing(result: EpisodeResult) -> Row:
    """Wall-clock figures, kept apart from the results because they differ from run to run."""
    planner_s = result.planner_s
    some = len(planner_s) > 0
    return {
        "planner": result.planner,
        "scenario_id": result.spec.scenario_id,
        "ticks": len(planner_s),
        "start_s": float(result.start_s),
        "sim_s": float(result.sim_s),
        "planner_s": float(planner_s.sum()),
        "planner_mean_s": float(planner_s.mean()) if some else None,
        "planner_p95_s": float(np.percentile(planner_s, 95)) if some else None,
        "planner_max_s": float(planner_s.max()) if some else None,
        "total_s": float(result.total_s),
    }


def lost_timing(spec: ScenarioSpec, planner: str, total_s: float) -> Row:
    """Timing of an episode whose worker died; total_s: s from when it was begun."""
    row: Row = dict.fromkeys(("start_s", "sim_s", "planner_s", "planner_mean_s", "planner_p95_s", "planner_max_s"))
    return {**row, "planner": planner, "scenario_id": spec.scenario_id, "ticks": None, "total_s": total_s}


def cut_short(story: str) -> str:
    """A story of an error without its middle where it is endless."""
    half = _STORY_CHARS // 2
    return story if len(story) <= _STORY_CHARS else f"{story[:half]}\n(...)\n{story[-half:]}"


def last_seconds(result: EpisodeResult) -> str:
    """The ego's last ticks as a table in plain text, "" if there was not even a first one."""
    if result.facts is None:
        return ""
    lines = ["  time_s        x        y  heading   speed  lane  asked acceleration, steering"]
    first = max(len(result.facts.snapshots) - _SHOWN_TICKS, 0)
    for number, snapshot in enumerate(result.facts.snapshots[first:], start=first):
        ego = snapshot.ego
        asked = ", ".join(f"{v:.3f}" for v in result.commands[number]) if number < len(result.commands) else "-"
        lines.append(
            f"{snapshot.time:8.1f} {ego.x:8.2f} {ego.y:8.2f} {ego.heading:8.3f} {ego.speed:7.2f} {ego.lane:5d}  {asked}"
        )
    return "\n".join(lines)


def head_row(spec: ScenarioSpec, planner: str, privileged: bool, outcome: Outcome, error: str | None) -> Row:
    """The columns that do not depend on what happened."""
    row: Row = {"planner": planner}
    row.update({name: getattr(spec, name) for name in SPEC_COLUMNS})
    row.update(privileged=privileged, outcome=outcome.value, error=error)
    return row


def make_record(result: EpisodeResult, privileged: bool) -> Record:
    """The record of an episode that came to its end, error outcomes included."""
    if result.outcome.is_error or result.facts is None:
        outcome = result.outcome if result.outcome.is_error else Outcome.SIM_ERROR
        row = error_row(result.spec, result.planner, privileged, outcome, result.error)
        return Record(row, [], make_timing(result), result.detail or result.error)
    row, events = score(result.spec, result.planner, privileged, result.facts)
    return Record(row, events, make_timing(result), "")


def score(spec: ScenarioSpec, planner: str, privileged: bool, facts: EpisodeFacts) -> tuple[Row, list[Row]]:
    """Row and events of an episode that ended without an error."""
    row = head_row(spec, planner, privileged, facts.outcome, None)
    row.update({name: _plain(value) for name, value in episode_metrics(facts).items()})
    key = {"planner": planner, "scenario_id": spec.scenario_id}
    found = [(facts.verdicts.against, True)]
    found += [(verdict.violations, False) for verdict in facts.verdicts.others]
    events = [{**key, "target": target, **_event(event)} for some, target in found for event in some]
    events.sort(key=lambda event: (not event["target"], event["start_s"], event["sign_id"], event["clause"]))
    for number, event in enumerate(events):
        event["number"] = number
    return row, events


def _event(event: Violation) -> Row:
    return {field.name: _plain(getattr(event, field.name)) for field in fields(Violation)}


def _plain(value: Any) -> Any:
    """NumPy scalars as Python's own, so that JSON takes them and types do not depend on the path taken."""
    return value.item() if isinstance(value, np.generic) else value
