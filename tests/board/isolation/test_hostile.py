"""Cheats and attacks of planners in a sandbox: each comes to nothing, or is named as the planner's own fault."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import hostile
import pytest
from patience import HANG_S
from rich.console import Console

from tsbench.board.isolation import process
from tsbench.board.isolation.isolated_loading import describe
from tsbench.board.isolation.protocol import EndMessage, frame
from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.run.execution.messages import Limits
from tsbench.run.listener import ProgressWatcher
from tsbench.run.log.journal import read_table
from tsbench.run.options import RunOptions
from tsbench.run.session import run

FILE = Path(hostile.__file__)
SCENE = "main_road-j-msk-04a4d86d4d-v1"
CHEATS = (
    "ByTable", "ByFile", "ByGc", "Teleports", "RemovesTraffic", "PatchesScorer", "PatchesEnding", "PatchesMonitors",
)  # fmt: skip
# Nothing comes of them. `Several` tries what takes nothing that the next one needs.
CONTAINED = ("Several", "ForkBomb", "Threads", "MemoryHog", "DiskHog", "FillsShm", "Floods")
# The planner's fault, and what is said of it.
NAMED = {
    "Exits": "planner_error: the planner's process ended: exit code 3",
    # All are its own.
    "KillsAll": "planner_error: the planner's process ended: SIGKILL",
    "SignalsParent": "planner_error: the planner's process ended: SIG",
    "Crashes": "planner_error: the planner's process ended: SIGSEGV",
    "Garbage": "invalid_output: a message of 4294967295 bytes",
    "Oversize": "invalid_output: a message of 1073741824 bytes",
    "Counts": "invalid_output: no message of the protocol",
    "Twice": "invalid_output: more than one answer",
    "LongPlan": "invalid_output: at most 1000 rows",
    "OddIntent": "invalid_output: 'nowhere'",
    "Orphans": "planner_error: the planner's process ended: exit code 0",
    "fake_planners.py:ReturnsNone@107": "invalid_output: act returned NoneType",
    "fake_planners.py:Nan@107": "invalid_output: acceleration nan",
    "fake_planners.py:Inf@107": "invalid_output: steering inf",
    "fake_planners.py:WrongShape@107": "invalid_output: shapes",
    "fake_planners.py:Raises@107": "planner_error: RuntimeError: no idea what to do with <object object at",
    "fake_planners.py:PrintsAndRaises@107": "planner_error: ValueError: enough",
    "fake_planners.py:SysExits@107": "planner_error: SystemExit: bye",
    "fake_planners.py:Hostile@100": "invalid_output: Control cannot be read (SystemExit: read)",
    "fake_planners.py:Hostile@101": "planner_error: Own: mine",
    "fake_planners.py:Hostile@102": "planner_error: KeyboardInterrupt: stop",
    "fake_planners.py:Hostile@103": "planner_error: GeneratorExit: gone",
    "fake_planners.py:Hostile@104": "planner_error: ValueError: half a character: \\ud800",
    "fake_planners.py:Hostile@105": "planner_error: Mute: (its text cannot be had)",
    "fake_planners.py:Hostile@106": "planner_error: ValueError: word word",
    "fake_planners.py:Hostile@107": "planner_error: the planner's process ended",
    "fake_planners.py:Hostile@108": "planner_error: the planner's process ended",
    "fake_planners.py:Hostile@109": "invalid_output: no message of the protocol",
    "fake_planners.py:Hostile@112": "planner_error: MemoryError",
    "fake_planners.py:Hostile@115": "planner_error: SystemExit: reset",
}
Told = dict[str, tuple[list[object], str]]


def driven(place: str, *names: str, file: Path = FILE) -> Told:
    """Of each planner what came of an episode, and the error that was noted."""
    done = subprocess.run(
        [sys.executable, str(file), place, SCENE, *names],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, timeout=HANG_S, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TSBENCH_TEST_SECRET": "1"},
    )  # fmt: skip
    # Planners print, too.
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{"name": ')]
    told = {one["name"]: (one["told"], one["error"]) for one in lines}
    assert list(told) == list(names), f"{place}: exit status {done.returncode} after {[*told][-1:]}"
    return told


def test_cheats_work_beside_the_referee() -> None:
    honest, *cheats = (told for told, _ in driven("here", "Honest", *CHEATS, "Hoards").values())
    assert honest not in cheats


TRIED = ("Honest", "ByTable", "Teleports", "PatchesScorer", "Several", "Floods")
REST = tuple(name for name in (*CHEATS, *CONTAINED) if name not in TRIED)


@pytest.mark.parametrize("names", [TRIED, pytest.param(REST, marks=pytest.mark.slow)], ids=["some", "rest"])
def test_cheats_come_to_nothing_in_a_sandbox(names: tuple[str, ...], tmp_path: Path) -> None:
    ((honest, _),) = driven("here", "Honest").values()
    # A folder of its own: what lies beside a planner is part of it.
    file = Path(shutil.copy(FILE, tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as server:
        file.with_suffix(".port").write_text(str(server.getsockname()[1]))
        found = driven("sandbox", *names, file=file)
    assert found == dict.fromkeys(names, (honest, ""))


# One of each kind: how a process ends, what a message is, what an answer holds, what a planner raises.
SOME = (
    "Exits", "Garbage", "Twice", "LongPlan", "fake_planners.py:Nan@107", "fake_planners.py:Raises@107",
    "fake_planners.py:Hostile@105", "fake_planners.py:Hostile@109",
)  # fmt: skip
OTHERS = tuple(name for name in NAMED if name not in SOME)


@pytest.mark.parametrize("names", [SOME, pytest.param(OTHERS, marks=pytest.mark.slow)], ids=["some", "rest"])
def test_what_is_no_answer_is_named(names: tuple[str, ...]) -> None:
    assert misnamed(driven("sandbox", *names)) == {}


def misnamed(found: Told) -> Told:
    """What came to something else than it should have."""
    wrong = {}
    for name, (told, error) in found.items():
        outcome, _, words = NAMED[name].partition(": ")
        if told[0] != outcome or words not in error:
            wrong[name] = (told, error)
    return wrong


LATE = ("Hangs", "Spins", "Drips")
LARGE = ("Gorges", "ChildGorges")


def rows_of(out: Path, names: tuple[str, ...], limits: Limits) -> dict[str, dict[str, Any]]:
    """Of each planner the row of its one episode."""
    specs = tuple(f"{FILE}:{name}" for name in names)
    asked = RunOptions(
        specs, "dev", ("main_road",), 1, half="signed", workers=2, out=out, isolate=True, limits=limits,
        memory_limit=limits.most_memory, trace="none",
    )  # fmt: skip
    run(asked, ProgressWatcher(Console(quiet=True)))
    # Whatever became of them, nothing of them runs any more.
    left = [p for p in Path("/proc").glob("[0-9]*/cmdline") if any(f"{FILE}:{n}".encode() in _read(p) for n in names)]
    assert not left
    rows = {row["planner"]: row for row in read_table(out / "episodes.parquet").to_pylist()}
    assert rows.keys() == set(names)
    return rows


@pytest.mark.slow
def test_who_gives_no_answer_is_late_and_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    # None of them ever answers, so that no machine is too slow for limits as short as these.
    rows = rows_of(tmp_path / "run", LATE, Limits(call=0.5, first_call=0.5, patience=0.5))
    assert {row["outcome"] for row in rows.values()} == {Outcome.PLANNER_TIMEOUT}
    # Their workers were killed, and have left no folder of a sandbox.
    assert not list(temporary.iterdir())


def test_who_takes_too_much_is_gone_and_a_flooded_log_costs_nothing(tmp_path: Path) -> None:
    # Patient: only what they take is to end them, on a busy machine, too.
    limits = Limits(call=60.0, first_call=60.0, patience=5.0, most_memory=1200.0)
    rows = rows_of(tmp_path / "run", (*LARGE, "Floods"), limits)
    for name in LARGE:
        assert rows[name]["outcome"] == Outcome.PLANNER_ERROR
        assert "MB of memory (--memory-limit)" in rows[name]["error"]
    assert not Outcome(rows["Floods"]["outcome"]).is_error
    written = sum(path.stat().st_size for path in (tmp_path / "run").rglob("*") if path.is_file())
    assert written < 4 << 20, "a hundred megabytes to the log are not kept"


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


SILENT = """
import time

class AtStart:
    def __init__(self): time.sleep(1000)
    def reset(self, context): pass
    def act(self, o): pass
"""
# Says of itself what a terminal would obey, in the place of KEY.
RUDE = """
import json, msgspec, socket, struct
line = socket.socket(fileno=3)
told = {"kind": "hello", "protocol": 5, "name": "mine", **json.loads(KEY)}
data = msgspec.msgpack.encode(told)
line.sendall(struct.pack("<I", len(data)) + data)
while True:
    line.recv(1)
"""


def test_who_connects_and_says_nothing_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no watchdog looks: before a run, and when a planner is checked."""
    file = tmp_path / "silent.py"
    file.write_text(SILENT)
    monkeypatch.setattr(process, "_START_S", 1.0)
    with pytest.raises(InputError, match="does not come up isolated: the planner has not answered within 1 s"):
        describe(f"{file}:AtStart")
    monkeypatch.setattr(process, "_START_S", HANG_S)
    monkeypatch.setattr(process, "_ANSWER_S", 1.0)
    planner = process.PlannerProcess(rude(tmp_path, {}))
    with pytest.raises(process.IsolatedPlannerError, match="the planner has not answered within 1 s"):
        planner.ask(frame(EndMessage()))
    planner.close()


def rude(folder: Path, told: dict[str, Any]) -> str:
    program = folder / "rude"
    program.write_text(f"#!{sys.executable}\n{RUDE.replace('KEY', repr(json.dumps(told)))}")
    program.chmod(0o755)
    return f"exe:{program}"


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"name": "mi\x1b[2Jne"}, r"HelloMessage: control characters in the text mi\\x1b\[2Jne"),
        ({"weights_file": "gnp\u202egnp"}, "HelloMessage: control characters in the text"),
        ({"problem": "\x9b2J"}, "HelloMessage: control characters in the text"),
        ({"na\x1b[2Jme": "mine"}, r"isolated: .*unknown field `na\\x1b\[2Jme`"),
        ({"name": 7}, r"isolated: .*Expected `str`, got `int` - at `\$.name`"),
        ({"kind": "done"}, "isolated: .*unknown field"),
        ({"protocol": 3}, "speaks protocol 3, this tsbench 5"),
        ({"name": "x" * 101}, "says of itself what cannot be"),
        ({"name": "two\nlines"}, "says of itself what cannot be"),
    ],
)
def test_what_a_program_says_of_itself_is_text(told: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said) as refused:
        describe(rude(tmp_path, told))
    assert str(refused.value).isprintable()
