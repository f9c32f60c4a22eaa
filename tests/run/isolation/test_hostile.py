"""Cheats and attacks of planners in a cell: each comes to nothing, or is named as the planner's own fault."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import hostile
import pytest
from patience import HANG_S

from tsbench.episode.outcome import Outcome
from tsbench.run.execution.base import Limits
from tsbench.run.log.tables import read_table
from tsbench.run.plan import Request
from tsbench.run.progress import ProgressWatcher
from tsbench.run.session import Options, run

FILE = Path(hostile.__file__)
SCENE = "main_road-j-msk-45e4c9668c-v1"
CHEATS = (
    "ByTable", "ByFile", "ByGc", "Teleports", "RemovesTraffic", "PatchesScorer", "PatchesEnding", "PatchesMonitors",
)  # fmt: skip
# Nothing comes of them.
CONTAINED = (
    "ForkBomb", "Threads", "MemoryHog", "DiskHog", "OpensFiles", "LiftsLimits", "SeesProcesses", "KillsAll",
    "StopsParent", "Ptraces", "ReadsParent", "Inherits", "WritesRun", "Connects", "BecomesRoot", "Uncovers",
    "Environment",
)  # fmt: skip
# The planner's fault, and what is said of it.
NAMED = {
    "Exits": "planner_error: the planner's process ended: exit code 3",
    "Crashes": "planner_error: the planner's process ended: SIGSEGV",
    "Raises": "planner_error: KeyboardInterrupt",
    "Garbage": "invalid_output: a message of 4294967295 bytes",
    "Oversize": "invalid_output: a message of 1073741824 bytes",
    "Counts": "invalid_output: no message of the protocol",
    "Twice": "invalid_output: more than one answer",
    "HangsUp": "planner_error: the planner's process ended",
    "NaN": "invalid_output: not finite",
    "LongPlan": "invalid_output: at most 1000 rows",
    "OddIntent": "invalid_output: 'nowhere'",
    "NoCommand": "invalid_output: act returned str",
    "Orphans": "planner_error: the planner's process ended: exit code 0",
}


def driven(place: str, name: str) -> tuple[list[object], str]:
    """What came of an episode, and the error that was noted."""
    done = subprocess.run(
        [sys.executable, str(FILE), place, name, SCENE], capture_output=True, text=True, timeout=HANG_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TSBENCH_TEST_SECRET": "1"}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    return told["told"], told["error"]


@pytest.fixture(scope="module")
def cell() -> str:
    """The tests are of cells with namespaces of their own; elsewhere there is less to promise."""
    from tsbench.run.isolation.loading import describe

    if not describe(f"{FILE}:Honest").effects["namespaces"]:
        pytest.skip("this kernel, or container, lets nobody make namespaces")
    return "cell"


@pytest.fixture(scope="module")
def honest(cell: str) -> list[object]:
    found = driven("here", "Honest")[0]
    assert driven(cell, "Honest")[0] == found
    return found


@pytest.mark.parametrize("name", CHEATS)
def test_a_cheat_that_works_beside_the_referee_comes_to_nothing(
    name: str, honest: list[object], cell: str
) -> None:
    assert driven("here", name)[0] != honest
    assert driven(cell, name) == (honest, "")


@pytest.mark.parametrize("name", CONTAINED)
def test_an_attack_comes_to_nothing(name: str, honest: list[object], cell: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = FILE.with_suffix(".port")
        port.write_text(str(server.getsockname()[1]))
        try:
            assert driven(cell, name) == (honest, "")
        finally:
            port.unlink()


@pytest.mark.parametrize("name", NAMED)
def test_what_is_no_answer_is_named(name: str, cell: str) -> None:
    outcome, _, words = NAMED[name].partition(": ")
    told, error = driven(cell, name)
    assert told[0] == outcome
    assert words in error


@pytest.mark.parametrize("name", ["Hangs", "Spins"])
def test_who_gives_no_answer_is_late_and_gone(name: str, tmp_path: Path, cell: str) -> None:
    out = tmp_path / "run"
    request = Request((f"{FILE}:{name}", f"{FILE}:Honest"), "dev", ("main_road",), 1, "all", "signed")
    limits = Limits(call=1.0, first_call=4.0, patience=2.0)
    from rich.console import Console

    run(
        Options(request, workers=1, out=out, isolate=True, limits=limits),
        ProgressWatcher(Console(quiet=True)),
    )
    rows = {row["planner"]: row for row in read_table(out / "episodes.parquet").to_pylist()}
    assert rows[name]["outcome"] == Outcome.PLANNER_TIMEOUT
    assert not Outcome(rows["Honest"]["outcome"]).is_error
    assert json.loads((out / "run.json").read_text())["isolation"]["Honest"]["namespaces"]
    left = [p for p in Path("/proc").glob("[0-9]*/cmdline") if f"{FILE}:{name}".encode() in _read(p)]
    assert not left


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
