"""Which executor a session gets."""

from __future__ import annotations

from tsbench.core.extras import load
from tsbench.core.machine import own_cores
from tsbench.run.execution.executor import Executor, Limits
from tsbench.run.execution.local import Pool

EXECUTORS = ("local", "ray")


def make_executor(kind: str, workers: int | None, most: int, limits: Limits) -> Executor:
    """An executor, one of EXECUTORS. workers: how many, None = one for each core; never more than `most`.

    Raises InputError where Ray is asked for and not installed, or its cluster cannot be reached.
    """
    if kind == "ray":
        executor: Executor = load("tsbench.run.execution.ray").RayExecutor(workers, most, limits)
        return executor
    return Pool(min(workers or own_cores(), most), limits)
