"""The columns of a run's three tables, with their types and whether they may be null."""

from __future__ import annotations

from typing import Any

import pyarrow as pa

SCHEMA_VERSION = 1

_TEXT, _FLAG, _REAL, _COUNT, _LONG = pa.string(), pa.bool_(), pa.float64(), pa.int32(), pa.int64()


def _must(kind: pa.DataType, *names: str) -> list[Any]:
    return [pa.field(name, kind, nullable=False) for name in names]


def _may(kind: pa.DataType, *names: str) -> list[Any]:
    return [pa.field(name, kind, nullable=True) for name in names]


EPISODES = pa.schema(
    [
        *_must(_TEXT, "planner", "scenario_id", "scenario_type", "group", "sign_code"),
        *_may(_REAL, "sign_value"),
        *_must(_TEXT, "map_id", "family", "shape", "slot"),
        *_must(_COUNT, "variant"),
        *_must(_TEXT, "split"),
        *_must(_LONG, "seed"),
        *_must(_FLAG, "privileged"),
        *_must(_TEXT, "outcome"),
        *_may(_TEXT, "error"),
        *_may(_FLAG, "sign_compliant", "sign_engaged", "destination"),
        *_must(_FLAG, "scd"),
        *_may(_REAL, "route_completion", "driving_score", "efficiency"),
        *_may(_FLAG, "collision"),
        *_may(_TEXT, "collision_partner"),
        *_may(_FLAG, "at_fault", "off_road"),
        *_may(_REAL, "comfort", "mean_speed", "duration_s"),
        *_may(_COUNT, "steps", "violations"),
        *_may(_TEXT, "violation_clause"),
        *_may(
            _REAL, "violation_time_s", "violation_x", "violation_y", "violation_value", "violation_threshold"
        ),
        *_may(_COUNT, "violating_steps"),
        *_may(_REAL, "min_ttc", "min_pet", "max_overspeed"),
        *_may(_FLAG, "hard_braking", "stuck", "wrong_way"),
        *_may(_COUNT, "all_violations"),
    ]
)

VIOLATIONS = pa.schema(
    [
        *_must(_TEXT, "planner", "scenario_id"),
        *_must(_COUNT, "number"),
        *_must(_FLAG, "target"),
        *_must(_TEXT, "rule", "clause", "sign_id", "sign_code"),
        *_must(_REAL, "start_s", "end_s", "x", "y", "heading", "speed", "value", "threshold", "margin"),
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
