"""What a planner's process may do in its sandbox."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.run.isolation.loading import describe

# Says what it finds where its process can say it.
TELLS = """
import os
from pathlib import Path

class P:
    def __init__(self):
        told = [str(os.getuid() != 0), os.uname().nodename, *sorted(p.name for p in Path(__file__).parent.iterdir())]
        for change in (lambda: os.chmod("/dev/null", 0o600), lambda: os.chmod(__file__, 0o600)):
            try:
                change()
                told.append("changed")
            except OSError as refused:
                told.append(refused.strerror)
        Path("/dev/null").write_text("x")
        raise ValueError("; ".join(told))

    def reset(self, context): pass
    def act(self, o): pass
"""
# Calls the kernel by numbers, makes a thread and a process, and says what came of it.
CALLS = """
import ctypes, errno, json, os, sys, threading
SYSTEM = ctypes.CDLL(None, use_errno=True)
NUMBERS = {"x86_64": (250, 272, 56, 435, 39), "aarch64": (219, 97, 220, 435, 172)}

def told():
    keyctl, unshare, clone, clone3, getpid = NUMBERS[os.uname().machine]
    said = []
    # A keyring of the session; a namespace of users, three ways; what everybody may ask.
    for call in ((keyctl, 1, 0), (unshare, 0x10000000), (clone, 0x10000011, 0, 0, 0, 0), (clone3, 0, 0), (getpid,)):
        found = SYSTEM.syscall(*map(ctypes.c_long, call))
        if call[0] == clone and found == 0:
            os._exit(0)
        said.append("done" if found >= 0 else errno.errorcode[ctypes.get_errno()])
    thread = threading.Thread(target=said.append, args=("thread",))
    thread.start()
    thread.join()
    child = os.fork()
    if child == 0:
        os._exit(7)
    return [*said, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])]

class P:
    def __init__(self): raise ValueError(json.dumps(told()))
    def reset(self, context): pass
    def act(self, observation): pass

if __name__ == "__main__":
    print(json.dumps(told()))
"""


def test_nobody_is_root_in_a_sandbox(tmp_path: Path) -> None:
    """A folder that only root may read: neither the planner's own files nor devices can be changed, and the name is
    nobody's."""
    place = tmp_path / "own"
    place.mkdir(mode=0o700)
    (place / "mine.py").write_text(TELLS)
    (place / "weights").touch(mode=0o600)
    (place / "mine.py").chmod(0o600)
    if not describe("idm").effects["namespaces"]:
        pytest.skip("this kernel, or container, lets nobody make namespaces")
    refused = "Read-only file system"
    with pytest.raises(InputError, match=f"True; sandbox; mine.py; weights; {refused}; {refused}"):
        describe(f"{place}/mine.py:P")


@pytest.mark.skipif(platform.machine() not in ("x86_64", "aarch64"), reason="the filter is for these two")
def test_no_keys_and_no_namespaces_are_made_in_a_sandbox(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(CALLS)
    if not describe("idm").effects["refused_calls"]:
        pytest.skip("this kernel has no filters of system calls")
    outside = json.loads(subprocess.run([sys.executable, str(file)], capture_output=True, check=True).stdout)
    if outside[0] != "done":
        pytest.skip("keys are refused here in any case")
    assert outside[4:] == ["done", "thread", 7]
    with pytest.raises(InputError, match="EPERM") as refused:
        describe(f"{file}:P")
    text = str(refused.value)
    inside = json.loads(text[text.index("[") : text.index("]") + 1])
    assert inside == ["EPERM", "EPERM", "EPERM", "ENOSYS", "done", "thread", 7]
