"""Plans from a network on one device. A sample's plan does not hang on the others of its batch, to the bit.

Samples are grouped by how many objects they hold: each group has a fixed number of tokens, and torch multiplies a
sample of one group by the same routines whatever its company (tested for 1 to 8).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from tsbench.errors import InputError
from tsbench.geometry.polyline import Array
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.network import Plant2Network
from tsbench.planners.plant2.network_ft import Plant2FtNetwork
from tsbench.planners.weights import Tensors, load_weights, network

# Slots for objects: an empty street costs less than a full one.
BUCKETS = (6, 14, at.OBJECTS)
_SPEEDS = np.array(at.SPEEDS)


class PlanView(NamedTuple):
    """path: (20, 2), waypoints: (8, 2) m in the ego's frame; speed: wished, m/s."""

    path: Array
    waypoints: Array
    speed: float


class Inference:
    """A network that answers; evaluation mode, float32."""

    def __init__(self, net: Plant2Network, device: str = "cpu") -> None:
        self._net = net.to(device).eval()
        self._device = torch.device(device)

    @classmethod
    def from_weights(cls, name: str, folder: Path | None = None, device: str = "cpu") -> Inference:
        """The network that was saved under a name; InputError where its file is not one of `plant2`."""
        size = str(network(name, folder).training.get("size", ""))
        return cls(network_of(size, load_weights(name, folder), name), device)

    def plans(self, records: at.Records) -> list[PlanView]:
        """A plan for each of (b,) records of `layout.TOKENS` (or SIGN_TOKENS, where the network reads signs)."""
        groups: dict[int, list[int]] = {}
        for k, count in enumerate(np.count_nonzero(records["kinds"], axis=1).tolist()):
            groups.setdefault(next(b for b in BUCKETS if b >= count), []).append(k)
        found: dict[int, PlanView] = {}
        for slots, members in groups.items():
            found.update(zip(members, self._group(records[members], slots), strict=True))
        return [found[k] for k in range(len(records))]

    def _group(self, batch: at.Records, slots: int) -> list[PlanView]:
        with torch.inference_mode():
            tokens = tensors(batch, slots)
            plan = self._net({name: value.to(self._device) for name, value in tokens.items()}, forecast=False)
            path, waypoints, logits = (t.cpu().numpy() for t in (plan.path, plan.waypoints, plan.speed))
        return [PlanView(p, w, wished_speed(s)) for p, w, s in zip(path, waypoints, logits, strict=True)]


def tensors(batch: at.Records, slots: int = at.OBJECTS) -> dict[str, torch.Tensor]:
    """Records as tensors by field, with the first `slots` objects; a copy."""
    found = {}
    for name in batch.dtype.names or ():
        values = batch[name][:, :slots] if name in ("objects", "kinds") else batch[name]
        # A record's fields lie apart, which torch does not take, and a view of one row passes for contiguous.
        found[name] = torch.from_numpy(values.copy())
    return found


def wished_speed(logits: Array) -> float:
    """The mean of the speed classes, m/s."""
    weight = np.exp(logits.astype(np.float64) - float(logits.max()))
    return float(weight @ _SPEEDS / weight.sum())


def network_of(size: str, weights: Mapping[str, object] | Tensors, name: str) -> Plant2Network:
    """A network with given tensors, the fine-tuned one where they have a part of it; InputError where they fit none."""
    try:
        net = Plant2FtNetwork(size) if "speed_token" in weights else Plant2Network(size)
        net.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
    except (KeyError, RuntimeError) as error:
        problem = " ".join(str(error).split())[:200]
        raise InputError(f"weights {name!r}: are not those of a plant2 network ({problem})") from None
    return net
