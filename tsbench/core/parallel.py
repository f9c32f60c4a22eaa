"""The same work on many things in worker processes: in order, a bounded number under way, results kept on disk.

What is interrupted goes on where it stopped: a result that was kept, and made from the same, is not made again.
"""

from __future__ import annotations

import json
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tsbench.core.errors import TsbenchError
from tsbench.core.files import write_atomic
from tsbench.core.machine import die_with

# Started before the first of them is waited for: enough for any machine, few enough to hold.
_AHEAD = 64


@dataclass(frozen=True, slots=True)
class CachedResult:
    """Where a result stays: a JSON file. stamp: a digest of all that the result is made from."""

    path: Path
    stamp: str

    def read(self) -> Any:
        """The result; None if it is missing or was made from something else."""
        if not self.path.is_file():
            return None
        kept = json.loads(self.path.read_text(encoding="utf-8"))
        return kept["result"] if kept.get("stamp") == self.stamp else None

    def write(self, result: Any) -> None:
        """Keep what JSON can hold, NaN included."""
        write_atomic(self.path, json.dumps({"stamp": self.stamp, "result": result}).encode())


class Workers:
    """Starts work in the processes of `executor`."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def start(
        self,
        work: Callable[..., Any],
        *arguments: Any,
        kept: CachedResult | None = None,
        sound: Callable[[Any], bool] = lambda _: True,
    ) -> Callable[[], Any]:
        """Begin work(*arguments) unless a `sound` result is kept; returns what waits for the result and keeps it."""
        old = None if kept is None else kept.read()
        if old is not None and sound(old):
            return lambda: old
        future = self._executor.submit(work, *arguments)

        def finish() -> Any:
            result = future.result()
            if kept is not None:
                kept.write(result)
            return result

        return finish

    def ordered(
        self, work: Callable[..., Any], jobs: Iterable[tuple[Any, ...]], keep: Callable[..., CachedResult] | None = None
    ) -> Iterator[Any]:
        """Results of work(*job) in the order of `jobs`. keep(*job): where each stays."""
        running: deque[Callable[[], Any]] = deque()
        for job in jobs:
            running.append(self.start(work, *job, kept=None if keep is None else keep(*job)))
            if len(running) >= _AHEAD:
                yield running.popleft()()
        while running:
            yield running.popleft()()


@contextmanager
def worker_processes(count: int, doing: str) -> Iterator[Workers]:
    """So many processes, which end with this one. An error or Ctrl-C lets them finish what is begun, and nothing more.

    Raises TsbenchError where one dies; `doing` says at what.
    """
    executor = ProcessPoolExecutor(count, get_context("spawn"), _settle, (os.getpid(),))
    try:
        yield Workers(executor)
    except BrokenProcessPool as died:
        raise TsbenchError(f"a process died {doing}; run the same command again, it goes on there") from died
    finally:
        executor.shutdown(cancel_futures=True)


def _settle(parent: int) -> None:
    die_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
