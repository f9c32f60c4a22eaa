"""The published nuPlan figures that traffic and driver styles are drawn from.

Source: docs/simulation.md, "Traffic".
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from tsbench.core.paths import data_file
from tsbench.core.textfile import read_json


@cache
def statistics() -> dict[str, Any]:
    path = data_file("scenarios/nuplan_statistics.json")
    loaded: dict[str, Any] = read_json(path, "table of nuPlan's figures")
    return loaded


def quantile_speed(share: float) -> float:
    """Speed (m/s) of moving traffic at a share in [0, 1]: linear between the published quantiles."""
    table = statistics()["speed_mps"]
    at = [0.0, 0.05, 0.25, 0.5, 0.75, 0.85, 0.95, 0.99, 1.0]
    names = ["p5", "p25", "p50", "p75", "p85", "p95", "p99"]
    values = [0.5, *(float(table[n]) for n in names), float(table["p99"]) * 1.05]
    return float(np.interp(share, at, values))
