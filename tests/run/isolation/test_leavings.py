"""What an episode leaves in its sandbox, outside its own process, does not reach the next episode."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import leaving
import pytest

import tsbench
from tsbench.episode.trace import read_trace, trace_path
from tsbench.run.isolation import loading, process, system_calls
from tsbench.run.isolation.protocol import MessageKind, pack
from tsbench.run.planner_info import describe

FILE = Path(leaving.__file__)
FIRST = 0.2


def test_no_bit_that_an_episode_leaves_reaches_the_next(tmp_path: Path) -> None:
    out = tmp_path / "run"
    made = tsbench.evaluate(
        [f"{FILE}:{name}" for name in leaving.ALL], split="dev", types=["speed_limit"], limit=2, workers=1,
        trace="all", isolate=True, out=out,
    )  # fmt: skip
    assert not made.episodes.error.notna().any()
    found: dict[str, list[float]] = {name: [] for name in leaving.ALL}
    for row in made.episodes.itertuples():
        trace = read_trace(trace_path(out, row.planner, row.scenario_id))
        found[row.planner].append(float(trace.commands[0, 0]))
    assert found == dict.fromkeys(leaving.ALL, [FIRST, FIRST])


def test_who_handles_signals_is_marked() -> None:
    """Signals of an episode reach the process that episodes are forks of."""
    assert describe(f"{FILE}:Handler").may_remember
    assert loading.describe(f"{FILE}:Handler").planner.may_remember
    assert not describe(f"{FILE}:Place").may_remember


class Told:
    """Stands for a planner's process that says how it begins its episodes, and leaves something in the first."""

    made = 0

    def __init__(self) -> None:
        Told.made += 1
        self.facts = {"forks": True}

    def ask(self, request: bytes) -> tuple[MessageKind, bytes]:
        if request == pack(MessageKind.END) and Told.made == 1:
            raise process.IsolatedPlannerError("ended")
        return MessageKind.DONE, b""

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
    monkeypatch.setattr(system_calls.platform, "machine", lambda: machine)
    program = system_calls.call_filter()
    if own is not None:
        assert verdict(program, machine, numbers[machine], own) == ALLOWED, call
    if other is not None:
        assert verdict(program, machine, numbers[machine], other) == REFUSED, call
