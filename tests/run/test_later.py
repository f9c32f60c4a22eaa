"""What a planner opens and leaves in episodes: the run knows it by the files, and marks it where it may remember."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest
from patience import HANG_S

import tsbench
from tsbench.core.errors import InputError
from tsbench.run import opened_files, session
from tsbench.run.log.manifest import marks_of, read_manifest
from tsbench.run.planner_info import describe

PLANNER = """
import ctypes, os, signal, socket, sqlite3, subprocess, sys
from pathlib import Path
from tsbench import Control

HERE = Path(__file__).parent

class Mine:
    def reset(self, context):
        self.told = 0.5
        {deed}
    def act(self, observation):
        return Control(self.told, 0.0)
"""
READS = "self.told = float((HERE / ('weights' + '.txt')).read_text())"


def planner(folder: Path, deed: str) -> str:
    folder.mkdir(exist_ok=True)
    (folder / "weights.txt").write_text("0.5")
    (folder / "mine.py").write_text(PLANNER.format(deed=deed))
    return f"{folder / 'mine.py'}:Mine"


def drive(out: Path, spec: str, limit: int = 2) -> tsbench.Run:
    return tsbench.evaluate([spec], split="dev", types=["speed_limit"], limit=limit, workers=1, out=out)


def test_a_file_that_an_episode_reads_counts_as_the_planner_s(tmp_path: Path) -> None:
    spec, out = planner(tmp_path / "mine", READS), tmp_path / "run"
    drive(out, spec)
    (told,) = json.loads((out / "run.json").read_text())["later"]
    assert [line.partition("  ")[2] for line in told["opened"]] == ["weights.txt"]
    assert (told["planner"], told["left"]) == ("Mine", [])
    # Nothing is driven, and nothing has changed.
    assert len(drive(out, spec).episodes) == 2
    (tmp_path / "mine" / "weights.txt").write_text("0.25")
    with pytest.raises(InputError, match=r"weights\.txt has changed since the run began: start the run anew"):
        drive(out, spec)


def test_a_run_that_was_broken_off_knows_its_files_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its manifest is as it was when it began: only the journal says what episodes have opened and left."""
    # Only the first session's episode leaves something.
    deed = READS + "; Path('note').exists() or Path('note').touch()"
    spec, out, copy = planner(tmp_path / "mine", deed), tmp_path / "run", tmp_path / "copy"
    code = (
        "import os, sys, tsbench\n"
        "from tsbench.run.log import folder\n"
        "kept = folder.RunFolder.keep\n"
        "def keep(self, record):\n    kept(self, record)\n    os._exit(9)\n"
        "folder.RunFolder.keep = keep\n"
        "tsbench.evaluate([sys.argv[1]], split='dev', types=['speed_limit'], limit=2, workers=1, out=sys.argv[2])\n"
    )
    done = subprocess.run([sys.executable, "-c", code, spec, str(out)], cwd=tmp_path, timeout=HANG_S, check=False)
    assert done.returncode == 9
    monkeypatch.chdir(tmp_path)
    assert Path("note").exists()
    assert "later" not in json.loads((out / "run.json").read_text())
    shutil.copytree(out, copy)
    drive(copy, spec)
    manifest = read_manifest(copy)
    assert manifest is not None
    assert marks_of(manifest) == {"Mine": "may remember"}
    (tmp_path / "mine" / "weights.txt").write_text("0.25")
    for _ in range(2):
        # The second time, too: the first has let go of the folder.
        with pytest.raises(InputError, match=r"weights\.txt has changed since the run began"):
            drive(out, spec)


LEAVES = {
    "writes": "Path('note').write_text('x')",
    "touches": "Path('note').touch()",
    "appends": "open(HERE / 'weights.txt', 'a').close()",
    "makes a folder": "Path('note').mkdir(exist_ok=True)",
    "links": "(os.path.lexists('note') or os.symlink('there', 'note'))",
    "removes": "Path('note').unlink(missing_ok=True)",
    "renames": "os.rename(HERE / 'weights.txt', HERE / 'weights.txt')",
    "sets a mode": "(HERE / 'weights.txt').chmod(0o600)",
    "sets times": "os.utime(HERE / 'weights.txt', (1, 1))",
    "sets an attribute": 'exec(\'try: os.setxattr(__file__, "user.a", b"1")\\nexcept OSError: pass\')',
    "keeps a table": "sqlite3.connect('note').close()",
    "starts a program": "subprocess.run(['true'])",
    "starts a shell": "os.system('true')",
    "forks": "os.fork() or os._exit(0)",
    "connects": "socket.socket(socket.AF_UNIX).connect_ex('nobody')",
    "signals": "os.kill(os.getppid(), 0)",
    "calls C": "ctypes.CDLL(None).mkdir(b'note', 0o700)",
}


def test_whose_constructor_takes_functions_of_c_may_do_what_nobody_sees(tmp_path: Path) -> None:
    made = "class P:\n    floor = False\n    def __init__(self):\n        self.write = ctypes.CDLL(None).creat\n"
    (tmp_path / "mine.py").write_text(
        f"import ctypes\n{made}    def reset(self, c): pass\n    def act(self, o): pass\n"
    )
    assert describe(f"{tmp_path / 'mine.py'}:P").unseen == ("ctypes",)


STAYS = {
    "nothing": "pass",
    "reads": READS,
    "prints": "print('x', flush=True); sys.stderr.write('y')",
    "throws away": "Path('/dev/null').write_text('x')",
    "imports": "sys.path.insert(0, str(HERE)); import beside",
}


@pytest.mark.parametrize("deed", LEAVES)
def test_who_leaves_something_outside_its_process_in_an_episode_is_seen(
    deed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert left_by(LEAVES[deed], tmp_path, monkeypatch)


@pytest.mark.parametrize("deed", STAYS)
def test_who_leaves_nothing_is_not(deed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "beside.py").write_text("")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    assert left_by(STAYS[deed], tmp_path, monkeypatch) == ()
    assert deed != "imports" or [*(tmp_path / "mine" / "__pycache__").iterdir()]


def left_by(deed: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """What is seen of a deed as of an episode's, in this process."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "beside", raising=False)
    planner(folder / "mine", deed)
    made: dict[str, object] = {"__file__": str(folder / "mine" / "mine.py")}
    exec((folder / "mine" / "mine.py").read_text(), made)
    mine = made["Mine"]()  # type: ignore[operator]
    with opened_files.noted() as seen:
        mine.reset(None)
    return seen.left


def test_a_planner_that_writes_is_marked_in_all_that_a_run_says(tmp_path: Path) -> None:
    deed = f"(Path({str(tmp_path)!r}) / 'note').write_text('x')"
    spec, out = planner(tmp_path / "mine", deed), tmp_path / "run"
    drive(out, spec)
    manifest = read_manifest(out)
    (told,) = manifest["later"]
    assert told["left"] == [f"open {tmp_path / 'note'}"]
    assert "may remember" in (out / "summary.json").read_text()
    # A complete run that nothing is driven for says the same.
    drive(out, spec)
    again = read_manifest(out)
    assert again is not None
    assert marks_of(again) == {"Mine": "may remember"}


def test_a_note_of_an_episode_that_ends_its_process_counts(tmp_path: Path) -> None:
    """Killed as from outside, it is driven once more, and then finds its note."""
    note = f"Path({str(tmp_path / 'note')!r})"
    deed = f"{note}.exists() or ({note}.touch(), os.kill(os.getpid(), signal.SIGKILL))"
    spec, out = planner(tmp_path / "mine", deed), tmp_path / "run"
    drive(out, spec, limit=1)
    manifest = read_manifest(out)
    assert manifest["later"][0]["left"] == ["an episode that did not end"]


HONEST = """
from tsbench import Control

class {name}:
    floor = False
    def reset(self, context): pass
    def act(self, observation):
        {deed}
        return Control(1.0, 0.0)
"""
# Once its module is loaded, what stands in the file is another planner's.
REWRITES = "open(__file__, 'a').write('more = 1\\n')"


def status(out: Path) -> str:
    return str(json.loads((out / "run.json").read_text())["status"])


@pytest.mark.parametrize("deed", ["pass", REWRITES])
def test_who_rewrites_a_planner_on_disk_is_named(tmp_path: Path, deed: str) -> None:
    file, out = tmp_path / "mine.py", tmp_path / "run"
    file.write_text(HONEST.format(name="Mine", deed=deed))
    if deed == "pass":
        drive(out, f"{file}:Mine", limit=1)
        assert status(out) == "complete"
        return
    with pytest.raises(InputError, match=r"mine\.py:Mine': its code has changed since the run began"):
        drive(out, f"{file}:Mine", limit=1)
    assert status(out) == "interrupted"
    with pytest.raises(InputError, match=r"holds another run: planner .* has changed since"):
        drive(out, f"{file}:Mine", limit=1)


def test_a_planner_may_extend_the_path_of_its_modules(tmp_path: Path) -> None:
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "deeds_of_mine.py").write_text("GENTLE = 1.0\n")
    file, out = tmp_path / "mine.py", tmp_path / "run"
    found = f"import sys\nsys.path.insert(0, {str(tmp_path / 'library')!r})\nimport deeds_of_mine\n"
    file.write_text(found + HONEST.format(name="Mine", deed="pass"))
    drive(out, f"{file}:Mine", limit=1)
    assert status(out) == "complete"
    (tmp_path / "library" / "deeds_of_mine.py").write_text("GENTLE = 2.0\n")
    with pytest.raises(InputError, match=r"holds another run: planner .* has changed since"):
        drive(out, f"{file}:Mine", limit=1)


def test_a_run_of_two_states_of_tsbench_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What is found at the start of the run, and at its end.
    times = count()
    monkeypatch.setattr(session, "code_stamps", lambda: {Path("seeds.py"): (0, next(times))})
    with pytest.raises(InputError, match="tsbench's code has changed since the run began"):
        drive(tmp_path / "run", "idm", limit=1)
    assert status(tmp_path / "run") == "interrupted"
    monkeypatch.undo()
    run = drive(tmp_path / "run", "idm", limit=1)
    assert status(tmp_path / "run") == "complete"
    # Which code made its first rows is not known.
    assert run.edition.endswith("+local")
