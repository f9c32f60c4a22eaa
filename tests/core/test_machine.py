"""Looking at processes that start and end meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest

from tsbench.core.machine import (
    children_of,
    module_command,
    one_thread_each,
    processor_s,
    resident_below_mb,
    resident_mb,
)

# Starts a process that ends at once, waits for it, and so on.
RESTLESS = """
import os
while True:
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitpid(child, 0)
"""
LEAST_S, PATIENCE_S = 1.0, 60.0


def test_children_are_those_of_every_thread_until_they_are_waited_for() -> None:
    started: list[subprocess.Popen[bytes]] = []
    go, leave = threading.Event(), threading.Event()

    def start() -> None:
        started.append(subprocess.Popen(["sleep", "60"]))
        go.set()
        leave.wait()

    thread = threading.Thread(target=start)
    thread.start()
    go.wait()
    try:
        (child,) = started
        assert child.pid in children_of()
        assert children_of() == children_of(os.getpid())
        assert children_of(child.pid) == []
        child.kill()
        child.wait()
        assert child.pid not in children_of()
    finally:
        leave.set()
        thread.join()


def test_what_has_ended_has_no_children_and_no_memory() -> None:
    child = subprocess.Popen(["true"])
    child.wait()
    assert children_of(child.pid) == []
    assert resident_mb(child.pid) == resident_below_mb(child.pid) == processor_s(child.pid) == 0.0


def test_children_that_end_while_somebody_looks_stop_nobody() -> None:
    restless = subprocess.Popen([sys.executable, "-I", "-S", "-c", RESTLESS])
    try:
        seen, began = set[int](), time.monotonic()
        while time.monotonic() < began + (LEAST_S if len(seen) > 1 else PATIENCE_S):
            seen |= set(children_of(restless.pid))
            assert resident_below_mb(restless.pid) >= 0.0
        assert len(seen) > 1
    finally:
        restless.kill()
        restless.wait()


def test_they_have_one_thread_and_the_training_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with one_thread_each(), ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        told = [pool.submit(os.getenv, f"{name}_NUM_THREADS").result() for name in ("OMP", "OPENBLAS")]
    assert told == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_a_module_is_run_as_by_its_name_and_garbage_is_collected_seldom(tmp_path: Path) -> None:
    code = "import gc, sys\nprint(__name__, __spec__.name, gc.get_threshold()[0], sys.argv[1:])"
    (tmp_path / "told.py").write_text(code)
    command = [*module_command("told"), "one", "two"]
    done = subprocess.run(command, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True, check=True)
    assert done.stdout == "__main__ told 20000 ['one', 'two']\n"
