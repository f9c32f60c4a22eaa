"""What the driver of a Ray cluster costs: CPU time of its process for each episode, with a runner that takes no time.

PYTHONPATH=tests/helpers:tests/run python packaging/driver_cost.py 4000
"""

from __future__ import annotations

import os
import sys
import tempfile
import time

import ray.cluster_utils
from run_helpers import HERE

from tsbench.episode.perception_level import EXACTLY
from tsbench.run.edition import contract_hash
from tsbench.run.execution.messages import Limits, Setup, Task, TaskQueue
from tsbench.run.execution.ray import RayExecutor
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog


def main(count: int) -> None:
    sys.path.append(str(HERE))
    cluster = ray.cluster_utils.Cluster()
    cluster.add_node(num_cpus=0)
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    os.environ["RAY_ADDRESS"] = cluster.address
    rows = DataSet().table("test")[:count]
    contract = contract_hash(DataSet().table("test"), load_catalog())
    kept: list[object] = []
    with RayExecutor(2, count, Limits()) as pool, tempfile.TemporaryDirectory() as out:
        (who,) = pool.probe(["fake_planners:Good"])
        setup = Setup((who,), EXACTLY, "cpu", "none", out, DataSet(), "test", contract, runner="fake_runner:FakeRunner")
        tasks = TaskQueue(Task(k, 0, row) for k, row in enumerate(rows, start=1))
        began, wall = time.process_time(), time.monotonic()
        pool.run(setup, tasks, kept.append, lambda: False)
        spent, wall = time.process_time() - began, time.monotonic() - wall
    cluster.shutdown()
    each, rate = 1e3 * spent / len(kept), len(kept) / wall
    print(f"{len(kept)} episodes: {each:.3f} ms of the driver's CPU each, {rate:.0f} a second")


if __name__ == "__main__":
    main(int(sys.argv[1]))
