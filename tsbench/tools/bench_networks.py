"""What an answer of each network costs on this machine: asked one thing at a time, and eight at once."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from tsbench.planners.common.batching import Infer, Records
from tsbench.tools.doctor.arithmetic import NETWORKS, batched, questions

_ROUNDS, _BATCH = 30, 8


def bench_networks() -> Iterator[tuple[str, float, float]]:
    """(planner, CPU ms for one answer alone, ms for each of eight); the least over many rounds, as others disturb."""
    for name in NETWORKS:
        infer = batched(name).network("cpu")
        asked = np.resize(questions(name), _BATCH)
        yield name, _least(infer, asked[:1]), _least(infer, asked) / _BATCH


def _least(infer: Infer, asked: Records) -> float:
    took = []
    for _ in range(_ROUNDS):
        began = time.process_time()
        infer(asked)
        took.append(time.process_time() - began)
    return 1000.0 * min(took)
