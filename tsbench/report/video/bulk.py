"""One file for each of many traces, made in parallel processes. What is already there is kept: resumable."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import cv2

from tsbench.core.errors import InputError, TsbenchError
from tsbench.episode.trace import Trace, read_trace
from tsbench.run.execution.worker_main import die_with
from tsbench.sim.world import DT_S

# Makes a file (the second path) from a trace; whole or not at all.
Maker = Callable[[Trace, Path], None]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Job:
    """A trace, and the file to make from it."""

    trace: Path
    out: Path

    @property
    def done(self) -> bool:
        """Has it been made from this trace? A later run may have written the trace anew."""
        return self.out.is_file() and self.out.stat().st_mtime >= self.trace.stat().st_mtime


@dataclass(frozen=True, slots=True)
class Counts:
    """What came of it. failed: traces and why, in one line each. driven_s: length of the episodes made now.

    cpu_s: of all processes, the encoder's too, without their start; wall_s: from beginning to end.
    """

    made: int
    kept: int
    failed: tuple[tuple[Path, str], ...]
    driven_s: float
    cpu_s: float
    wall_s: float


def make_files(jobs: Sequence[Job], make: Maker, workers: int, progress: Progress) -> Counts:
    """Make what is not there yet. progress: called with the number done and the total.

    A bad trace or scene costs its own file only. Raises TsbenchError where a process dies.
    """
    begun = time.monotonic()
    todo = [job for job in jobs if not job.done]
    kept = len(jobs) - len(todo)
    progress(kept, len(jobs))
    failed: list[tuple[Path, str]] = []
    driven = cpu = 0.0
    context = get_context("spawn")
    count = min(workers, max(len(todo), 1))
    with ProcessPoolExecutor(count, context, _settle, (os.getpid(),)) as pool:
        running = {pool.submit(_make, job, make): job for job in todo}
        try:
            for number, future in enumerate(as_completed(running), start=1):
                try:
                    seconds, spent = future.result()
                    driven, cpu = driven + seconds, cpu + spent
                except InputError as problem:
                    failed.append((running[future].trace, str(problem)))
                progress(kept + number, len(jobs))
        except BrokenProcessPool as died:
            raise TsbenchError(
                "a drawing process died; run the same command again, it goes on there"
            ) from died
        finally:
            _cancel(running)
    made = len(todo) - len(failed)
    return Counts(made, kept, tuple(sorted(failed)), driven, cpu, time.monotonic() - begun)


def _cancel(running: dict[Future[tuple[float, float]], Job]) -> None:
    for future in running:
        future.cancel()


def _settle(parent: int) -> None:
    """Each process is one thread, dies with its parent, and leaves Ctrl-C to it."""
    die_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)


def _make(job: Job, make: Maker) -> tuple[float, float]:
    """Length of the episode and CPU time, s."""
    before = _cpu_s()
    trace = read_trace(job.trace)
    make(trace, job.out)
    return len(trace.snapshots) * DT_S, _cpu_s() - before


def _cpu_s() -> float:
    """CPU time of this process and of those it has waited for."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
