"""Scenario rows with their certificates as tables of a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tsbench.report.page.packing import pack_table
from tsbench.scenarios.certificates import Certificate
from tsbench.scenarios.spec import ScenarioSpec

_YES = ["no", "yes", "–"]
_GOOD, _BAD = {"yes": "good", "no": "bad"}, {"no": "bad"}
COLUMNS: tuple[dict[str, Any], ...] = (
    {"name": "scenario_type", "label": "type", "kind": "text", "filter": "choice"},
    {"name": "group", "label": "group", "kind": "text", "filter": "choice", "minor": True},
    {"name": "split", "label": "split", "kind": "text", "filter": "choice"},
    {"name": "map_id", "label": "map", "kind": "text", "filter": "text"},
    {"name": "variant", "label": "variant", "kind": "number", "digits": 0},
    {"name": "expert", "label": "solved by", "kind": "text", "filter": "choice", "marks": {"nobody": "bad"},
     "title": "the expert that obeyed the sign and arrived"},
    {"name": "expert_time_s", "label": "after", "kind": "number", "unit": "s", "minor": True},
    {"name": "tempting", "label": "tempting", "kind": "flag", "words": _YES, "filter": "choice", "marks": _GOOD,
     "title": "a driver who does not see signs failed"},
    {"name": "tempted_outcome", "label": "tempted driver", "kind": "text", "filter": "choice", "minor": True},
    {"name": "engaged", "label": "engaged", "kind": "flag", "words": _YES, "minor": True,
     "title": "the rule bound the tempted driver"},
    {"name": "sane", "label": "sane", "kind": "flag", "words": _YES, "filter": "choice", "marks": _BAD,
     "title": "traffic as asked, nobody inside another, both episodes came to an end"},
    {"name": "reproduced", "label": "again", "kind": "flag", "words": _YES, "minor": True, "marks": _BAD,
     "title": "a second process drove it to the same bytes"},
    {"name": "asked_density", "label": "asked", "kind": "number", "unit": "cars/lane-km",
     "title": "density of moving cars that the scene asks for"},
    {"name": "realised_density", "label": "realised", "kind": "number", "unit": "cars/lane-km"},
    {"name": "arrival_gap_s", "label": "gap", "kind": "number", "unit": "s", "minor": True,
     "title": "the convoy's unhindered arrival at the conflict zone less the ego's"},
    {"name": "scenario_id", "label": "scenario", "kind": "text", "minor": True},
)  # fmt: skip
_DETAILS = (
    ("sign_code", "text"), ("sign_value", "number"), ("initial_speed", "number"), ("route_length", "number"),
    ("horizon", "number"), ("density", "number"), ("drivers", "number"), ("layout", "number"), ("seed", "text"),
    ("shape", "text"), ("family", "text"), ("attempt", "number"), ("road_users", "number"), ("tempted", "text"),
)  # fmt: skip


def pack_rows(rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> bytes:
    """The table of scenarios, for `tsb.table`."""
    values = {column["name"]: _column(column["name"], rows, proofs) for column in COLUMNS}
    values["expert"] = [name or "nobody" for name in values["expert"]]
    return pack_table(COLUMNS, values)


def pack_details(rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> bytes:
    """What a scene's own view says besides, in the same order."""
    columns = [{"name": name, "label": name.replace("_", " "), "kind": kind} for name, kind in _DETAILS]
    values = {name: _column(name, rows, proofs) for name, _ in _DETAILS}
    values["seed"] = [str(seed) for seed in values["seed"]]
    return pack_table(columns, values)


def _column(name: str, rows: Sequence[ScenarioSpec], proofs: Sequence[Certificate]) -> list[Any]:
    source: Sequence[Any] = rows if hasattr(rows[0], name) else proofs
    return [_plain(getattr(item, name)) for item in source]


def _plain(value: Any) -> Any:
    """JSON has no NaN; two digits are enough to look at."""
    if isinstance(value, float):
        return round(value, 2) if math.isfinite(value) else None
    return value
