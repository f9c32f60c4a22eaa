"""From what the heads answer to plans."""

from __future__ import annotations

import numpy as np

from tsbench.geometry.elementary import exp
from tsbench.geometry.polyline import Array
from tsbench.planners.common.fixed_point import tree_sum
from tsbench.planners.plant2 import layout as at

_SPEEDS = np.array(at.SPEEDS)


def plans(steps: Array, waypoint_steps: Array, logits: Array) -> at.Records:
    """(b,) of PLAN from steps along path and waypoints, (b, 2 k) m, and the logits of the speed classes."""
    answers: at.Records = np.empty(len(logits), dtype=at.PLAN)
    answers["path"] = steps.reshape(-1, at.PATH_POINTS, 2).cumsum(axis=1)
    answers["waypoints"] = waypoint_steps.reshape(-1, at.WAYPOINTS, 2).cumsum(axis=1)
    answers["speed"], answers["standing"] = target_speed_of(logits)
    return answers


def target_speed_of(logits: Array) -> tuple[Array, Array]:
    """The mean of the speed classes, m/s, and the share of standing: of (..., 8) logits."""
    weight = exp(logits - logits.max(axis=-1, keepdims=True))
    total = tree_sum(weight)[..., 0]
    return tree_sum(weight * _SPEEDS)[..., 0] / total, weight[..., 0] / total
