"""A process's folder: gone after its owner was killed, and where a planner does not come up."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hostile import __file__ as hostile_file
from patience import HANG_S

from tsbench.board.isolation.process import PlannerProcess
from tsbench.core.errors import InputError
from tsbench.run.execution.own_folder import ACTOR, SANDBOX, OwnFolder, remove_abandoned

_OWNER = (
    "import sys, time; from tsbench.run.execution.own_folder import OwnFolder; "
    "f = OwnFolder(sys.argv[1]); (f.path / 'x').touch(); print(f.path, flush=True); time.sleep(1000)"
)


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where folders are made in these tests."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def test_a_planner_that_does_not_come_up_leaves_nothing(place: Path) -> None:
    for spec in (f"{hostile_file}:NotThere", "exe:/not/there"):
        with pytest.raises(InputError):
            PlannerProcess(spec)
        assert not list(place.iterdir())


@pytest.mark.parametrize("prefix", [ACTOR, SANDBOX])
def test_folders_of_the_killed_are_removed_and_those_of_the_living_are_not(prefix: str, place: Path) -> None:
    owner = subprocess.Popen([sys.executable, "-c", _OWNER, prefix], stdout=subprocess.PIPE, text=True)
    theirs = Path(owner.stdout.readline().strip())
    assert theirs.parent == place
    remove_abandoned()
    assert (theirs / "x").is_file()
    owner.send_signal(signal.SIGKILL)
    owner.wait(HANG_S)
    assert (theirs / "x").is_file()
    own = OwnFolder(SANDBOX)
    assert list(place.iterdir()) == [own.path]
    own.remove()
    own.remove()
    assert not list(place.iterdir())
