"""Plans from a network by torch, for a GPU; what drives on a CPU is `engine.py`.

Samples are grouped by how many objects they hold, so that a sample's plan hangs little on the others of its batch. Its
last bits depend on the device and on torch's version.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.engine import target_speed_of
from tsbench.learn.plant2.plant2_network import Plant2FtNetwork, Plant2Network
from tsbench.planners.batching import Infer

# Slots for objects: an empty street costs less than a full one.
BUCKETS = (6, 14, at.OBJECTS)


def inference(net: Plant2Network, device: str) -> Infer:
    """A network that answers (b,) records of TOKENS (SIGN_TOKENS, where it reads signs) with (b,) of PLAN."""
    net = net.to(device).eval()

    def infer(records: at.Records) -> at.Records:
        answers: at.Records = np.empty(len(records), dtype=at.PLAN)
        counts = np.count_nonzero(records["kinds"], axis=1)
        slots = np.take(BUCKETS, np.searchsorted(BUCKETS, counts))
        with torch.inference_mode():
            for bucket in BUCKETS:
                rows = np.flatnonzero(slots == bucket)
                if len(rows):
                    answers[rows] = _group(net, records[rows], bucket, device)
        return answers

    return infer


def _group(net: Plant2Network, batch: at.Records, slots: int, device: str) -> at.Records:
    tokens = {name: value.to(device) for name, value in tensors(batch, slots).items()}
    plan = net(tokens, forecast=False)
    answers: at.Records = np.empty(len(batch), dtype=at.PLAN)
    answers["path"], answers["waypoints"] = plan.path.cpu().numpy(), plan.waypoints.cpu().numpy()
    answers["speed"], answers["standing"] = target_speed_of(plan.speed.cpu().double().numpy())
    return answers


def tensors(batch: at.Records, slots: int = at.OBJECTS) -> dict[str, torch.Tensor]:
    """Records as tensors by field, with the first `slots` objects; a copy."""
    found = {}
    for name in batch.dtype.names or ():
        values = batch[name][:, :slots] if name in ("objects", "kinds") else batch[name]
        # A record's fields lie apart, which torch does not take, and a view of one row passes for contiguous.
        found[name] = torch.from_numpy(values.copy())
    return found


def network_of(size: str, weights: Mapping[str, Any]) -> Plant2Network:
    """A network with given arrays, the fine-tuned one where they have a part of it.

    Raises KeyError or RuntimeError where they fit none.
    """
    net = Plant2Network(size)
    if "speed_token" in weights:
        net = Plant2FtNetwork(size, len(weights["signs.weight"]))
    net.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
    return net
