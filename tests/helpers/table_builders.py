"""Tables of episode records made by hand or by chance, for tests of aggregation and of the report."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

GROUPS = ("priority", "speed", "obstacles", "routing")


def row(planner: str = "idm", kind: str = "yield", group: str = "priority", map_id: str = "m0", variant: int = 0,
        scd: bool = True, outcome: str = "arrived", **other: Any) -> dict[str, Any]:  # fmt: skip
    done = outcome not in ("sim_error", "planner_error", "planner_timeout", "invalid_output")
    metrics: dict[str, Any] = {
        "scd": scd, "destination": outcome == "arrived", "sign_compliant": scd, "sign_engaged": True,
        "driving_score": 100.0 if scd else 50.0, "route_completion": 100.0, "efficiency": None,
        "collision": outcome == "collision", "off_road": False, "comfort": 0.5, "mean_speed": 7.0,
    }  # fmt: skip
    metrics = {k: v if done else None for k, v in (metrics | other).items()}
    names = {"planner": planner, "scenario_id": f"{kind}-{map_id}-{variant}", "scenario_type": kind, "group": group}
    alone = {"pair_id": "", "half": "signed", "place": ""}
    return {**names, "map_id": map_id, "outcome": outcome, **alone, **metrics}


def pair(signed: bool = True, contrast: bool = True, *, outcomes: tuple[str, str] = ("arrived", "arrived"),
         contrast_kind: str = "", **other: Any) -> list[dict[str, Any]]:  # fmt: skip
    """Both rows of a pair, and whether they were passed. contrast_kind: type of the contrast plate, "" = the same."""
    first = row(scd=signed, outcome=outcomes[0], **other)
    name = first["scenario_id"]
    second = row(scd=contrast, outcome=outcomes[1], **other) | {"scenario_id": f"{name}-c", "half": "contrast"}
    second["scenario_type"] = contrast_kind or first["scenario_type"]
    return [made | {"pair_id": name} for made in (first, second)]


def records(rows: list[dict[str, Any]]) -> pa.Table:
    text = {"planner", "scenario_id", "scenario_type", "group", "map_id", "outcome", "pair_id", "half", "place"}
    flags = {"scd", "destination", "sign_compliant", "sign_engaged", "collision", "off_road"}
    kinds = {k: pa.string() if k in text else pa.bool_() if k in flags else pa.float64() for k in row()}
    return pa.Table.from_pylist(rows, schema=pa.schema(list(kinds.items())))


def random_rows(
    planners: tuple[str, ...] = ("idm",), types: int = 6, maps: int = 8, variants: int = 3, errors: float = 0.0,
    seed: int = 0,
) -> list[dict[str, Any]]:  # fmt: skip
    rng = np.random.default_rng(seed)
    rows = []
    for planner in planners:
        for t in range(types):
            for m in range(maps):
                rate = rng.beta(1, 2)
                for v in range(variants):
                    bad = rng.random() < errors
                    made = row(planner, f"type{t:02d}", GROUPS[t % 4], f"map{t}-{m}", v, bool(rng.random() < rate),
                               "sim_error" if bad else "arrived", efficiency=float(rng.uniform(60, 130)))  # fmt: skip
                    rows.append(made)
    return rows
