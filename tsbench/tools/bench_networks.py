"""What an answer of each network costs on this machine, one and eight at once, and what `plant2-ft` costs whole."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.common.batching import Infer, Records
from tsbench.planners.registry import resolve
from tsbench.scenarios.table import read_table, table_path
from tsbench.tools.check import choose
from tsbench.tools.doctor.arithmetic import NETWORKS, batched, questions

_ROUNDS, _BATCH = 30, 8
WHOLE = "plant2-ft"
_SCENES, _WHOLE_ROUNDS = 4, 3


def bench_networks() -> Iterator[tuple[str, float, float]]:
    """(planner, CPU ms for one answer alone, ms for each of eight); the least over many rounds, as others disturb."""
    for name in NETWORKS:
        infer = batched(name).network("cpu")
        asked = np.resize(questions(name), _BATCH)
        yield name, _least(infer, asked[:1]), _least(infer, asked) / _BATCH


def bench_whole() -> float:
    """CPU ms of a tick of WHOLE's episodes with all that belongs to them, on scenes of the dev split: least of a few
    rounds.
    """
    rows = choose(read_table(table_path("dev")), _SCENES)
    runner = EpisodeRunner(resolve(WHOLE))
    took = []
    for _ in range(_WHOLE_ROUNDS):
        began = time.process_time()
        ticks = sum(len(runner.run(row).commands) for row in rows)
        took.append(1000.0 * (time.process_time() - began) / ticks)
    runner.close()
    return min(took)


def _least(infer: Infer, asked: Records) -> float:
    took = []
    for _ in range(_ROUNDS):
        began = time.process_time()
        infer(asked)
        took.append(time.process_time() - began)
    return 1000.0 * min(took)
