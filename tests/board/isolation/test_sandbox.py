"""What a planner's process may do in its sandbox."""

from __future__ import annotations

import json
import os
import platform
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S, eventually

from tsbench.board.isolation import kernel_limits, sandbox
from tsbench.board.isolation.isolated_loading import describe
from tsbench.board.isolation.process import Printed
from tsbench.board.isolation.sandbox_contents import covered
from tsbench.core.errors import InputError

# Says what it finds where its process can say it.
TELLS = """
import os
from pathlib import Path

class P:
    def __init__(self):
        told = [str(os.getuid() != 0), os.uname().nodename, *sorted(p.name for p in Path(__file__).parent.iterdir())]
        # The mode that it has: nothing is lost on this machine where that is not refused.
        for place in ("/dev/null", __file__):
            try:
                os.chmod(place, os.stat(place).st_mode & 0o777)
                told.append("changed")
            except OSError as refused:
                told.append(refused.strerror)
        Path("/dev/null").write_text("x")
        for place in ("/new", "/dev/new", "/work/new"):
            try:
                Path(place).mkdir()
                told.append(place)
            except OSError:
                pass
        status = Path("/proc/self/status").read_text().splitlines()
        told += [line for line in status if line.startswith(("CapEff", "NoNewPrivs", "Seccomp:"))]
        raise ValueError("; ".join(told))

    def reset(self, context): pass
    def act(self, o): pass
"""
# Calls the kernel by numbers, makes a thread and a process, and says what came of it.
CALLS = """
import ctypes, errno, json, os, sys, threading
SYSTEM = ctypes.CDLL(None, use_errno=True)
NUMBERS = {"x86_64": (250, 272, 56, 435, 101, 39), "aarch64": (219, 97, 220, 435, 117, 172)}

def told():
    keyctl, unshare, clone, clone3, ptrace, getpid = NUMBERS[os.uname().machine]
    said = []
    # A keyring of the session; a namespace of users, three ways; a process that there is not; what everybody may ask.
    for call in ((keyctl, 1, 0), (unshare, 0x10000000), (clone, 0x10000011, 0, 0, 0, 0), (clone3, 0, 0),
                 (ptrace, 16, 1 << 22, 0, 0), (getpid,)):
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


# How a run is started: as it is, and by a user who is not root.
STARTED = {"as it is": (), "by a user": ("unshare", "--user", "--map-user=1000", "--map-group=1000")}
# In a namespace of users where nobody may make another of any kind: as on a kernel that has none.
REFUSED = (
    "unshare", "--user", "--map-root-user", "sh", "-c",
    "for kind in user mnt pid net ipc uts; do echo 0 > /proc/sys/user/max_${kind}_namespaces || exit 9; done; "
    'exec "$@"', "sh",
)  # fmt: skip


def said_of(spec: str, before: tuple[str, ...] = ()) -> str:
    """Why a planner does not come up, in a process that is started with `before`."""
    place = "tsbench.board.isolation.isolated_loading"
    code = f"import sys; from {place} import describe; print(describe(sys.argv[1]).effects)"
    done = subprocess.run(
        [*before, sys.executable, "-c", code, spec], capture_output=True, text=True, timeout=HANG_S, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    return done.stdout if done.returncode == 0 else done.stderr.splitlines()[-1]


# What the machine's devices and cached files would tell other sandboxes, each as a call of Python.
LASTS = """
import ctypes, os
FILE = "/usr/bin/env"

class P:
    def __init__(self):
        file, told = os.open(FILE, os.O_RDONLY), []
        for call in (lambda: os.utime("/dev/full"), lambda: os.preadv(file, [bytearray(9)], 0, os.RWF_NOWAIT),
                     lambda: os.utime(file), lambda: os.pread(file, 9, 0)):
            try:
                call()
                told.append("done")
            except OSError as refused:
                told.append(type(refused).__name__)
        told.append(str(ctypes.CDLL(None).inotify_init1(0)))
        raise ValueError(" ".join(told))
    def reset(self, context): pass
    def act(self, o): pass
"""


def test_a_sandbox_leaves_no_time_and_sees_no_cache(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(LASTS)
    told = said_of(f"{tmp_path / 'mine.py'}:P")
    assert "PermissionError PermissionError PermissionError done -1" in told


@pytest.mark.parametrize("started", STARTED)
def test_nobody_is_root_in_a_sandbox(started: str, tmp_path: Path) -> None:
    """A folder that only root may read: neither the planner's own files nor devices can be changed, and the name is
    nobody's."""
    place = tmp_path / "own"
    place.mkdir(mode=0o700)
    (place / "mine.py").write_text(TELLS)
    (place / "weights").touch(mode=0o600)
    (place / "mine.py").chmod(0o600)
    told = said_of(f"{place}/mine.py:P", STARTED[started])
    # The user of this test owns the devices, being root for the machine.
    device = "changed" if started == "by a user" and os.geteuid() == 0 else "Operation not permitted"
    assert f"True; sandbox; mine.py; weights; {device}; Read-only file system" in told
    assert "/new" not in told
    assert "CapEff: 0000000000000000; NoNewPrivs: 1; Seccomp: 2" in told


@pytest.mark.skipif(platform.machine() not in ("x86_64", "aarch64"), reason="the filter is for these two")
@pytest.mark.parametrize("started", STARTED)
def test_no_keys_and_no_namespaces_are_made_in_a_sandbox(started: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(CALLS)
    outside = json.loads(subprocess.run([sys.executable, str(file)], capture_output=True, check=True).stdout)
    if outside[0] != "done":
        pytest.skip("keys are refused here in any case")
    assert outside[4:] == ["ESRCH", "done", "thread", 7]
    text = said_of(f"{file}:P", STARTED[started])
    inside = json.loads(text[text.index("[") : text.index("]") + 1])
    assert inside == ["EPERM", "EPERM", "EPERM", "ENOSYS", "EPERM", "done", "thread", 7]


# A program that comes up, and then works without end whatever happens to its line; the child it starts, too.
STAYS = """
import os, socket, struct
line = socket.socket(fileno=3)
data = b"\\x83\\xa4kind\\xa5hello\\xa8protocol\\x05\\xa4name\\xa5stays"
line.sendall(struct.pack("<I", len(data)) + data)
os.fork()
while True:
    pass
"""
HOLDS = """
import sys, time
from tsbench.board.isolation.process import PlannerProcess
held = PlannerProcess(sys.argv[1])
print("up", flush=True)
if sys.stdin.readline() == "close\\n":
    held.close()
    print("closed", flush=True)
time.sleep(1000)
"""


def running(word: str) -> list[str]:
    """Processes with a word in what they were started with, but for the test's own."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            told = place.read_bytes().decode(errors="replace")
        except OSError:
            continue
        if word in told and HOLDS not in told:
            found.append(told)
    return found


@pytest.mark.parametrize("end", ["close", "kill"])
@pytest.mark.parametrize("started", STARTED)
def test_all_that_a_planner_started_ends_with_its_sandbox_or_its_worker(started: str, end: str, tmp_path: Path) -> None:
    file = tmp_path / "stays"
    file.write_text(f"#!{sys.executable}\n{STAYS}")
    file.chmod(0o755)
    worker = subprocess.Popen(
        [*STARTED[started], sys.executable, "-c", HOLDS, f"exe:{file}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert worker.stdin
    assert worker.stdout
    try:
        assert worker.stdout.readline() == "up\n"
        assert running(str(file))
        if end == "close":
            print("close", file=worker.stdin, flush=True)
            assert worker.stdout.readline() == "closed\n"
        else:
            worker.kill()
        eventually(lambda: not running(str(file)))
    finally:
        worker.kill()
        worker.wait()


def test_where_nobody_may_make_namespaces_a_planner_is_not_driven() -> None:
    told = said_of("idm", REFUSED)
    assert "InputError: --isolate: bubblewrap makes no sandbox here (" in told
    assert "use --image, or leave out --isolate" in told


def test_without_bubblewrap_a_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: None if name == "bwrap" else f"/usr/bin/{name}")
    sandbox._maker.cache_clear()
    with pytest.raises(InputError, match=r"^--isolate: bwrap not found on PATH: install bubblewrap .0\.7 or newer"):
        describe("idm")
    assert not sandbox._maker.cache_info().currsize


def test_on_a_machine_whose_calls_are_not_known_nothing_is_driven(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_limits.platform, "machine", lambda: "riscv64")
    with pytest.raises(InputError, match="is for x86_64 and aarch64, and this is riscv64"):
        describe("idm")


def test_installed_scenes_are_covered_also_where_others_are_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They lie with Python's packages, which every sandbox shows."""
    scenes = tmp_path / "tsbench_data" / "scenarios"
    scenes.mkdir(parents=True)
    monkeypatch.syspath_prepend(tmp_path)
    assert scenes in covered(())


def test_what_lies_where_a_sandbox_has_nothing_is_not_covered(tmp_path: Path) -> None:
    """A cover is put on what is shown, and nowhere else: there bubblewrap would make a folder of that name."""
    own, copy = tmp_path / "own", tmp_path / "copy"
    for folder in (own / "runs", own / "data", copy / "data"):
        folder.mkdir(parents=True)
    (copy / "table").touch()
    maker = sandbox._Maker("bwrap", "0", "setpriv", "prlimit", as_root=True)
    covers = [str(own / name) for name in ("runs", "data", "table")]
    made = sandbox.sandbox_arguments(maker, [(str(copy), str(own))], covers)
    after = made[made.index(str(own)) + 1 :]
    assert [word for word in after if word.startswith(str(tmp_path))] == [covers[1], covers[1], covers[2]]


PRINTS = """
import os, sys
print("\\x1b]0;owned\\x07\\x1b[31mred", flush=True)
os.write(2, b"\\x1b[2Jcleared \\xe2\\x80\\xaeback \\xff")
# A terminal that is open can be read from, too.
assert not any(os.isatty(one) for one in range(10))

class P:
    def reset(self, context): pass
    def act(self, observation): pass
"""
DESCRIBES = "import sys; from tsbench.board.isolation.isolated_loading import describe; describe(sys.argv[1])"


def test_a_terminal_is_shown_text(tmp_path: Path) -> None:
    """By a run before it begins, `verify` and `planners check`: all ask a planner what it is."""
    file = tmp_path / "mine.py"
    file.write_text(PRINTS)
    ours, theirs = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", DESCRIBES, f"{file}:P"], stdin=theirs, stdout=theirs, stderr=theirs, timeout=HANG_S,
        check=False, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert done.returncode == 0, shown
    assert shown.splitlines() == ["\\x1b]0;owned\\x07\\x1b[31mred", "\\x1b[2Jcleared \\u202eback \ufffd"]


def test_of_a_flood_the_beginning_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    printed = Printed()
    subprocess.run(
        ["sh", "-c", "head -c 90000 /dev/zero | tr '\\0' x; echo; yes | head -c 9000000"], stdout=printed.end
    )
    printed.close_end()
    printed.wait()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "x" * 90_000
    assert set(lines[1:-1]) == {"y"}
    assert len("".join(lines[:-1])) <= 100_000
    assert lines[-1] == "(what the planner prints from here on is not shown)"


def test_one_long_line_is_no_way_round(capsys: pytest.CaptureFixture[str]) -> None:
    printed = Printed()
    subprocess.run(["sh", "-c", "head -c 9000000 /dev/zero | tr '\\0' x"], stdout=printed.end, check=True)
    printed.close_end()
    printed.wait()
    assert capsys.readouterr().err == "(what the planner prints from here on is not shown)\n"
