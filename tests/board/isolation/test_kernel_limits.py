"""The control group of a sandbox: what is written where, what it holds off, and that nothing of it is left."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from patience import HANG_S

from tsbench.board.isolation import kernel_limits, sandbox
from tsbench.board.isolation.isolated_loading import describe
from tsbench.board.isolation.kernel_limits import ControlGroup
from tsbench.board.isolation.process import PlannerProcess

MIB = 1 << 20
Kernel = Callable[..., Path]


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Kernel:
    """Makes folders that look like the kernel's; in these a file can be in the way of a folder's removal."""

    def make(membership: str, **controllers: str) -> Path:
        mounted = tmp_path / "cgroup"
        for place, names in controllers.items():
            folder = mounted / place.replace("__", "/").strip("_")
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "cgroup.subtree_control").write_text(names)
        (tmp_path / "membership").write_text(membership)
        monkeypatch.setattr(kernel_limits, "_MOUNTED", mounted)
        monkeypatch.setattr(kernel_limits, "_MEMBERSHIP", tmp_path / "membership")
        monkeypatch.setattr(kernel_limits, "_PATIENCE_S", 0.0)
        return mounted

    return make


def test_in_version_2_it_lies_in_the_nearest_group_whose_limits_can_be_divided(kernel: Kernel) -> None:
    mounted = kernel("0::/user/app/mine\n", user="cpu memory pids", user__app="memory pids", user__app__mine="")
    (member,) = ControlGroup(7 * MIB, 9).members
    assert member.parent.parent == mounted / "user/app"
    assert {file.name: file.read_text() for file in member.parent.iterdir()} == {
        "memory.max": str(7 * MIB),
        "pids.max": "9",
    }


@pytest.mark.parametrize("membership", ["0::/\n", "0::/user\n", "3:cpu:/\n0::/\n", ""])
def test_where_no_group_divides_its_limits_there_is_none(membership: str, kernel: Kernel) -> None:
    kernel(membership, user="cpu", _="")
    with pytest.raises(OSError, match="no control groups of memory and processes"):
        ControlGroup(MIB, 9)


def test_in_version_1_memory_and_processes_have_one_each(kernel: Kernel) -> None:
    mounted = kernel("8:pids:/\n4:memory,other:/a/b\n0::/\n", memory__a__b="", pids="")
    memory, pids = ControlGroup(7 * MIB, 9).members
    assert (memory.parent.parent, pids.parent.parent) == (mounted / "memory/a/b", mounted / "pids")
    assert (memory.with_name("memory.limit_in_bytes")).read_text() == str(7 * MIB)
    assert (pids.with_name("pids.max")).read_text() == "9"


def test_one_that_cannot_be_made_whole_leaves_nothing(kernel: Kernel) -> None:
    mounted = kernel("8:pids:/none\n4:memory:/\n", memory="")
    with pytest.raises(FileNotFoundError):
        ControlGroup(MIB, 9)
    # The file in it, which the kernel's own folder would not count, keeps this one.
    left = [path for path in (mounted / "memory").rglob("*") if path.is_file()]
    assert [path.name for path in left if path.name != "cgroup.subtree_control"] == ["memory.limit_in_bytes"]


def test_groups_of_workers_that_were_killed_go(kernel: Kernel) -> None:
    mounted = kernel("0::/user\n", user="memory pids")
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for owner in (ended.pid, os.getpid()):
        (mounted / "user" / f"tsbench-sandbox-{owner}-900").mkdir()
    ControlGroup(MIB, 9)
    names = {path.name for path in (mounted / "user").iterdir() if path.name.endswith("-900")}
    assert names == {f"tsbench-sandbox-{os.getpid()}-900"}


# One child after the other takes 40 MB and keeps them; says how many have.
TAKES = """
import os, signal
held, children = 0, []
for _ in range(4):
    end, start = os.pipe()
    child = os.fork()
    if child == 0:
        kept = bytearray(os.urandom(1) * (40 << 20))
        os.write(start, b"x")
        signal.pause()
    os.close(start)
    children.append(child)
    held += len(os.read(end, 1))
for child in children:
    os.kill(child, signal.SIGKILL)
print(held)
"""


def held_in(members: list[Path]) -> str:
    """What a program says that is started in a group as a sandbox's is."""
    done = subprocess.run(
        ["sh", "-c", sandbox._BEGIN, "sh", *map(str, members), "--", sys.executable, "-c", TAKES],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, timeout=HANG_S, check=False,
    )  # fmt: skip
    return done.stdout.strip()


def test_what_all_its_processes_hold_together_is_limited() -> None:
    """By the kernel: where 100 MB are allowed, four processes do not have 40 MB each."""
    try:
        group = ControlGroup(100 * MIB, 20)
    except OSError as problem:
        pytest.skip(f"no control group can be made here: {problem}")
    assert held_in([]) == "4"
    assert held_in(group.members) in ("", "1", "2")
    group.remove()
    assert not any(member.parent.exists() for member in group.members)


def test_a_sandbox_is_in_the_group_that_it_has_and_takes_it_along(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[ControlGroup] = []

    def noted(memory_bytes: int, processes: int) -> ControlGroup:
        made.append(ControlGroup(memory_bytes, processes))
        return made[-1]

    monkeypatch.setattr(sandbox, "ControlGroup", noted)
    process = PlannerProcess("idm")
    if not process.effects["control_group"]:
        process.close()
        pytest.skip("no control group can be made here")
    (group,) = made
    # bubblewrap twice, and the planner.
    assert [len(member.read_text().split()) for member in group.members] == [3] * len(group.members)
    process.close()
    assert not any(member.parent.exists() for member in group.members)


def test_a_run_says_whether_it_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    try:
        ControlGroup(MIB, 9).remove()
        possible = True
    except OSError:
        possible = False
    effects = describe("idm").effects
    assert effects["control_group"] is possible
    assert ("MEMORY" in effects["limits"]) is possible
    monkeypatch.setattr(sandbox, "ControlGroup", forbidden)
    effects = describe("idm").effects
    assert (effects["control_group"], "MEMORY" in effects["limits"]) == (False, False)
