"""Runs episodes: what a session asks of the worker processes of this machine, or of those of a cluster."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Self

from tsbench.core.machine import MemoryUse
from tsbench.run.execution.messages import Setup, TaskQueue
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo


@dataclass(frozen=True)
class Limits:
    """How long a worker may show no sign of life, s of its processor time, and how large it may become, MB.

    call: in one call of the planner; first_call: making it, `reset` and the first `act` of an episode;
    phase: loading, simulating, scoring; start: being asked what a planner is. patience: wall-clock limit as a
    multiple of these, because a sleeping planner uses no processor. most_memory: resident size of a worker and
    all that it has started, over which it is ended at once. memory: its own size over which it is replaced between
    two episodes, though not before its `least_episodes`-th, so that a planner that needs as much is not loaded again
    for each.
    """

    call: float = 10.0
    first_call: float = 60.0
    phase: float = 60.0
    start: float = 120.0
    patience: float = 5.0
    most_memory: float = 4096.0
    memory: float = 2048.0
    least_episodes: int = 20


class Executor(Protocol):
    """Runs episodes somewhere; used in a `with` block, whose end leaves no process behind."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, *_: object) -> None: ...

    def probe(self, specs: Sequence[str], device: str = "cpu") -> list[PlannerInfo]:
        """What each planner is, made with its network on a device.

        Raises InputError: it does not exist, does not import, cannot be made there, or takes too long to.
        """

    def run(self, setup: Setup, tasks: TaskQueue, keep: Callable[[Record], None], stop: Callable[[], bool]) -> None:
        """Run all tasks; `keep` gets each record as it comes, once its trace lies in the run folder.

        Ends early once `stop` says so. Raises InputError: the run folder takes nothing more, or no worker is left.
        """

    def memory(self) -> list[MemoryUse]:
        """What the workers of this machine took, those that have ended included."""
