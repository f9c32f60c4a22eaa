"""Which executor a session gets."""

from __future__ import annotations

from tsbench.core.extras import load
from tsbench.core.machine import own_cores
from tsbench.run.execution.executor import Executor, Limits
from tsbench.run.execution.local import Pool

EXECUTORS = ("local", "ray")
# Episodes at once for each core, where an inference process answers them in batches.
_OVERSUBSCRIPTION = 4


def make_executor(kind: str, workers: int | None, most: int, limits: Limits) -> Executor:
    """An executor, one of EXECUTORS. workers: for how many cores, None = all; more than one of them drive more episodes
    at once where these mostly wait for an inference process; never more than `most`.

    Raises InputError where Ray is asked for and not installed, or its cluster cannot be reached.
    """
    if kind == "ray":
        executor: Executor = load("tsbench.run.execution.ray").RayExecutor(workers, most, limits)
        return executor
    cores = workers or own_cores()
    waiting = 1 if workers == 1 else _OVERSUBSCRIPTION * cores
    return Pool(min(cores, most), limits, oversubscribed=min(waiting, most))
