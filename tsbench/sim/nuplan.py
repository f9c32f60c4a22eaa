"""The published nuPlan figures that traffic and driver styles are drawn from.

Source: docs/simulation.md, "Traffic".
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from tsbench.core.paths import data_file
from tsbench.core.textfile import read_json
from tsbench.geometry.polyline import Array

DENSITY_KEY = "moving_cars_per_lane_within_150m"
SPEED_KEY = "initial_speed_mps"
LANE_KM_WITHIN_REACH = 0.3


@cache
def statistics() -> dict[str, Any]:
    path = data_file("scenarios/nuplan_statistics.json")
    loaded: dict[str, Any] = read_json(path, "table of nuPlan's figures")
    return loaded


def quantiles(key: str) -> tuple[Array, Array]:
    """The published quantiles of one figure.

    Returns: shares (k,) in (0, 1) increasing, and values (k,) increasing.
    """
    table = {float(name[1:]) / 100: float(v) for name, v in statistics()[key].items() if name[1:].isdigit()}
    shares = sorted(table)
    return np.array(shares), np.array([table[share] for share in shares])


def quantile(key: str, share: float) -> float:
    """A figure's value at a share in [0, 1]: linear between the published quantiles and on beyond the outermost."""
    at, values = quantiles(key)
    end = 0 if share < at[0] else -1
    if at[0] <= share <= at[-1]:
        return float(np.interp(share, at, values))
    slope = (values[1] - values[0]) / (at[1] - at[0]) if end == 0 else (values[-1] - values[-2]) / (at[-1] - at[-2])
    return float(values[end] + slope * (share - at[end]))


def quantile_speed(share: float) -> float:
    """Speed (m/s) of moving traffic at a share in [0, 1]: linear between the published quantiles."""
    at, values = quantiles("speed_mps")
    return float(np.interp(share, [0.0, *at, 1.0], [0.5, *values, values[-1] * 1.05]))
