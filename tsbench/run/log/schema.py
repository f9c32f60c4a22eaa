"""The columns of a run's three tables, with their types and whether they may be null."""

from __future__ import annotations

from functools import partial

import pyarrow as pa

from tsbench.core.parquet import columns
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.metrics.scd import SCD
from tsbench.scenarios.spec import SIGNED

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
