"""What an episode leaves in its sandbox, outside its own process, does not reach the next episode."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import leaving
import pytest
from patience import HANG_S

from tsbench.board.isolation import isolated_loading as loading
from tsbench.board.isolation import kernel_limits, process
from tsbench.board.isolation.protocol import VERSION, Answer, DoneMessage, EndMessage, HelloMessage, frame

FILE = Path(leaving.__file__)
FIRST = 0.2


# In the line, and numbers of the kernel.
SOME = ("LineName", "Processes")
# What is compared is the same where nothing was changed: else no test here shows anything.
UNCHANGED = {"Nothing": [FIRST, 2 * FIRST]}
REST = tuple(name for name in leaving.ALL if name not in SOME)
# What starts a run. The log's pipe is a user's own, and root's is not its planner's.
BY_USER = ("unshare", "--user", "--map-user=1000", "--map-group=1000")


@pytest.mark.parametrize(
    ("before", "names"),
    [
        pytest.param((), (*SOME, *UNCHANGED), id="some"),
        pytest.param((), REST, id="rest", marks=pytest.mark.slow),
        pytest.param(BY_USER, leaving.IN_LOG, id="by a user", marks=pytest.mark.slow),
    ],
)
def test_no_bit_that_an_episode_leaves_reaches_the_next(
    before: tuple[str, ...], names: tuple[str, ...], tmp_path: Path
) -> None:
    done = subprocess.run(
        [*before, sys.executable, str(FILE), str(tmp_path / "run"), *names],
        stdout=subprocess.PIPE, text=True, timeout=HANG_S, check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    told = {name: sorted(commands) for name, commands in json.loads(done.stdout).items()}
    assert told == {name: UNCHANGED.get(name, [FIRST, FIRST]) for name in names}


def test_what_a_constructor_makes_for_all_episodes_is_marked() -> None:
    """Signals of an episode reach the process that episodes are forks of, and its messages another one."""
    remembers = {"Handler": True, "Daemon": True, "Nameless": True, "ReadOnlyMemory": True, "Place": False}
    # Each in a process of its own, not in this one: it would have the handler and the other process.
    code = """
import os, sys
from tsbench.run.planner_info import describe
for spec in sys.argv[1:]:
    if child := os.fork():
        os.waitpid(child, 0)
    else:
        print(describe(spec).may_remember, flush=True)
        os._exit(0)
"""
    told = subprocess.run(
        [sys.executable, "-c", code, *(f"{FILE}:{name}" for name in remembers)],
        capture_output=True, text=True, timeout=HANG_S, check=True,
    )  # fmt: skip
    assert told.stdout.split() == [str(mark) for mark in remembers.values()]
    for name, mark in remembers.items():
        assert loading.describe(f"{FILE}:{name}").planner.may_remember is mark


def test_a_process_with_another_parent_is_marked() -> None:
    assert loading.describe(f"{FILE}:Stray").planner.may_remember


class Told:
    """Stands for a planner's process that says how it begins its episodes, and leaves something in the first."""

    made = 0

    def __init__(self) -> None:
        Told.made += 1
        self.facts = HelloMessage(VERSION, forks=True)

    def ask(self, request: bytes) -> Answer:
        if request == frame(EndMessage()) and Told.made == 1:
            raise process.IsolatedPlannerError("ended")
        return DoneMessage()

    def close(self) -> None:
        pass


class Silent:
    def context(self, context: object) -> bytes:
        return b""


def test_after_something_was_left_each_episode_has_a_new_sandbox(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether there is a new sandbox is a bit, too."""
    monkeypatch.setattr(process, "Encoder", Silent)
    planner = process.IsolatedPlanner(Told)  # type: ignore[arg-type]
    context: Any = None
    made = []
    for _ in range(4):
        planner.reset(context)
        made.append(Told.made)
    assert made == [1, 2, 3, 4]


class Keeps(Told):
    """Says where it is driven that it keeps its process."""

    def __init__(self) -> None:
        super().__init__()
        self.facts = HelloMessage(VERSION, keeps_process=True)


@pytest.mark.parametrize(("marked", "processes"), [(True, 1), (False, 4)])
def test_who_keeps_its_process_is_known_to_the_run(
    monkeypatch: pytest.MonkeyPatch, marked: bool, processes: int
) -> None:
    """It may have said something else when it was asked what it is, and be marked by that."""
    monkeypatch.setattr(process, "Encoder", Silent)
    monkeypatch.setattr(Told, "made", 0)
    planner = process.IsolatedPlanner(Keeps, keeps=marked)  # type: ignore[arg-type]
    context: Any = None
    for _ in range(4):
        planner.reset(context)
    assert Told.made == processes


# What a filter says of a call, by the numbers of the kernel's calls on two kinds of machines.
ALLOWED, REFUSED = 0x7FFF0000, 0x00050001
ARCH = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
CALLS = [
    ("prlimit64", {"x86_64": 302, "aarch64": 261}, (0, 7), (5, 7)),
    ("setpriority", {"x86_64": 141, "aarch64": 140}, (0, 0, 5), (0, 5, 5)),
    ("setpriority of a group", {"x86_64": 141, "aarch64": 140}, (0, 0), (1, 0)),
    ("sched_setaffinity", {"x86_64": 203, "aarch64": 122}, (0,), (5,)),
    ("sched_setscheduler", {"x86_64": 144, "aarch64": 119}, (0,), (5,)),
    ("sched_setparam", {"x86_64": 142, "aarch64": 118}, (0,), (5,)),
    ("sched_setattr", {"x86_64": 314, "aarch64": 274}, (0,), (5,)),
    ("ioprio_set", {"x86_64": 251, "aarch64": 30}, (1, 0), (1, 5)),
    ("ioprio_set of a group", {"x86_64": 251, "aarch64": 30}, (1, 0), (2, 0)),
    ("socket", {"x86_64": 41, "aarch64": 198}, (1, 1), (2, 1)),
    ("clone", {"x86_64": 56, "aarch64": 220}, (0x11,), (0x10000011,)),
    ("semget", {"x86_64": 64, "aarch64": 190}, None, (0,)),
    ("msgget", {"x86_64": 68, "aarch64": 186}, None, (0,)),
    ("process_madvise", {"x86_64": 440, "aarch64": 440}, None, (0,)),
    ("getpid", {"x86_64": 39, "aarch64": 172}, (0,), None),
]


def verdict(program: bytes, machine: str, number: int, arguments: tuple[int, ...]) -> int:
    """What the kernel does with a call: its data are number, architecture, place, and six arguments."""
    data = struct.pack("<IIQ6Q", number, ARCH[machine], 0, *arguments, *[0] * (6 - len(arguments)))
    steps = list(struct.iter_unpack("=HBBI", program))
    at, held = 0, 0
    while True:
        operation, yes, no, value = steps[at]
        at += 1
        if operation == 0x06:
            return int(value)
        if operation == 0x20:
            (held,) = struct.unpack_from("<I", data, value)
        else:
            holds = {0x15: held == value, 0x35: held >= value, 0x45: bool(held & value)}[operation]
            at += yes if holds else no


@pytest.mark.parametrize("machine", ARCH)
@pytest.mark.parametrize(("call", "numbers", "own", "other"), CALLS, ids=[call[0] for call in CALLS])
def test_a_process_changes_its_own_state_and_no_other_s(
    call: str, numbers: dict[str, int], own: Any, other: Any, machine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_limits.platform, "machine", lambda: machine)
    program = kernel_limits.call_filter()
    if own is not None:
        assert verdict(program, machine, numbers[machine], own) == ALLOWED, call
    if other is not None:
        assert verdict(program, machine, numbers[machine], other) == REFUSED, call
