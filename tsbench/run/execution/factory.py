"""Which executor a session gets."""

from __future__ import annotations

from tsbench.core.extras import load
from tsbench.core.machine import own_cores
from tsbench.run.execution.base import Executor, Limits
from tsbench.run.execution.local import Pool

EXECUTORS = ("local", "ray")
# Episodes at once for each core, where an inference process answers them in batches.
_OVERSUBSCRIPTION = 4


def make_executor(kind: str, workers: int | None, most: int, limits: Limits) -> Executor:
    """An executor, one of EXECUTORS. workers: how many, None = one for each core, and more where those mostly wait for
    an inference process; never more than `most`.

    Raises InputError where Ray is asked for and not installed, or its cluster cannot be reached.
    """
    if kind == "ray":
        executor: Executor = load("tsbench.run.execution.ray").RayExecutor(workers, most, limits)
        return executor
    cores = own_cores()
    return Pool(
        min(workers or cores, most), limits, oversubscribed=min(workers or _OVERSUBSCRIPTION * cores, most)
    )
