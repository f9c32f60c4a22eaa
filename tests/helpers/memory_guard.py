"""The suite's workers stay small, so that several fit on a machine with others. A plugin of `tests/conftest.py`.

What tests have freed is given back to the system, and the test in which a worker (`pytest -n`) grows beyond `MOST_MB`
fails by name. One process may run all tests, and is then larger. Linux with glibc; elsewhere nothing is measured.
"""

from __future__ import annotations

import ctypes
import gc
import os
import re
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from tsbench.run.execution.memory import resident_mb

MOST_MB = 700.0
# Given back after a module, and after a test that leaves so much more than there was.
GROWTH_MB = 20.0
_STATUS = Path("/proc/self/status")
_PEAK = "peak_mb"


class TooLarge(Exception):
    """The worker has held more than a test may leave it with."""


def peak_mb() -> float:
    """The most that this process has held resident, MB (1e6 bytes); 0 where the system does not say."""
    # Not getrusage's figure, which begins with that of the process that started this one.
    found = re.search(r"VmHWM:\s*(\d+) kB", _STATUS.read_text()) if _STATUS.exists() else None
    return int(found.group(1)) * 1024 / 1e6 if found else 0.0


def requeue() -> None:
    """Return freed memory to the system: allocators keep it, and every module leaves its own holes."""
    gc.collect()
    if "pyarrow" in sys.modules:
        sys.modules["pyarrow"].default_memory_pool().release_unused()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


class MemoryGuard:
    """Watches the process that it runs in."""

    def __init__(self) -> None:
        # Once is enough; who is no worker is not told at all.
        self._told = "PYTEST_XDIST_WORKER" not in os.environ
        self._was = 0.0

    def look(self, where: str) -> None:
        """Raises TooLarge the first time that the process is found to have been too large."""
        if not self._told and peak_mb() > MOST_MB:
            self._told = True
            raise TooLarge(
                f"{where}: this worker of the suite has held {peak_mb():.0f} MB, more than {MOST_MB:.0f}. "
                "Keep less from test to test, or mark what is large with own_process (tests/helpers/own_process.py)"
            )

    def pytest_collection_finish(self) -> None:
        """Imports alone."""
        # What is there now stays: no collection of garbage needs to look at it again.
        requeue()
        gc.freeze()
        self._was = resident_mb(os.getpid())
        self.look("collecting the tests")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_teardown(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> Generator[None, None, None]:
        """After each test, its fixtures included."""
        yield
        over = nextitem is None or nextitem.path != item.path
        if over or resident_mb(os.getpid()) > self._was + GROWTH_MB:
            requeue()
            self._was = resident_mb(os.getpid())
        self.look(item.nodeid)


class Largest:
    """What the workers have held at most: a line at the end of the suite, so that one sees what is nearly too large."""

    def __init__(self) -> None:
        self._peaks: list[float] = []

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """A worker has stopped, and said what it held."""
        self._peaks.append(node.workeroutput.get(_PEAK, 0.0) if hasattr(node, "workeroutput") else 0.0)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """The line."""
        if self._peaks:
            terminalreporter.write_line(f"largest worker: {max(self._peaks):.0f} MB of {MOST_MB:.0f}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """In a worker: what is told to who started it."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput[_PEAK] = peak_mb()


def pytest_configure(config: pytest.Config) -> None:
    """Called by pytest."""
    config.pluginmanager.register(MemoryGuard(), "memory-guard-of-this-process")
    config.pluginmanager.register(Largest(), "largest-worker")
