"""What imitation is judged by: L1 on path and waypoints, cross-entropy on two-hot speed, L1 on the objects' ways."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.plant2_network import NetworkPlan

# So that no term drowns the others: a good path is wrong by centimetres, a good speed still by a quarter of a nat.
WEIGHTS = {"path": 1.0, "waypoints": 0.5, "speed": 0.5, "forecast": 0.2}


def two_hot(speed: Tensor) -> Tensor:
    """(b,) m/s to (b, 8): the weight is shared by the two classes around it, so that their mean is the speed."""
    classes = torch.tensor(at.SPEEDS, device=speed.device)
    v = speed.clamp(at.SPEEDS[0], at.SPEEDS[-1])
    upper = torch.searchsorted(classes, v, right=True).clamp(1, len(at.SPEEDS) - 1)
    share = (v - classes[upper - 1]) / (classes[upper] - classes[upper - 1])
    rows = torch.arange(len(v), device=v.device)
    target = torch.zeros((len(v), len(at.SPEEDS)), device=v.device)
    target[rows, upper - 1] = 1.0 - share
    target[rows, upper] = share
    return target


def losses(plan: NetworkPlan, frames: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Each term, unweighted; means over what is known. Forecasts only where the plan has them."""
    terms = {
        "path": _l1(plan.path, frames["path"], frames["path_known"]),
        "waypoints": _l1(plan.waypoints, frames["waypoints"], frames["waypoints_known"]),
        "speed": functional.cross_entropy(plan.speed, two_hot(frames["speed"])),
    }
    if plan.forecast is not None:
        terms["forecast"] = _l1(plan.forecast, frames["forecast"], frames["forecast_known"])
    return terms


def total(terms: Mapping[str, Tensor]) -> Tensor:
    return torch.stack([WEIGHTS[name] * value for name, value in terms.items()]).sum()


def _l1(found: Tensor, wanted: Tensor, known: Tensor) -> Tensor:
    weight = known.to(found.dtype)
    return ((found - wanted).abs().mean(-1) * weight).sum() / weight.sum().clamp_min(1.0)
