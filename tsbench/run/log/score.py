"""From an episode's result to its record: the metrics and the events of all signs."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.episode.result import EpisodeResult
from tsbench.metrics.episode_metrics import episode_metrics
from tsbench.rules.monitor import Violation
from tsbench.run.log.record import Record, Row, error_row, head_row, make_timing
from tsbench.scenarios.spec import ScenarioSpec


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
    found = [(facts.against, True)]
    found += [(verdict.violations, False) for verdict in facts.others]
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
