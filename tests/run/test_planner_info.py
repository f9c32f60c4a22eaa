"""What stands in a run's manifest about a planner's code."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from command_line import one_line

from tsbench.core.errors import InputError
from tsbench.planners.registry import comes_with_tsbench
from tsbench.run.planner_info import PlannerInfo, describe, resolve_unchanged
from tsbench.run.session import distinct

MINE = """
import neighbour
from kit import limits
from tsbench import Control

WEIGHTS = "net.npz"

def drive(o):
    return Control(neighbour.ACCELERATION, limits.STEERING)
"""


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A planner with a module, a package and a file of weights beside it."""
    folder = tmp_path / "hashed"
    (folder / "kit").mkdir(parents=True)
    (folder / "planner.py").write_text(MINE)
    (folder / "neighbour.py").write_text("ACCELERATION = 0.0\n")
    (folder / "kit" / "__init__.py").write_text("")
    (folder / "kit" / "limits.py").write_text("from .more import STEERING\n")
    (folder / "kit" / "more.py").write_text("STEERING = 0.0\n")
    (folder / "net.npz").write_bytes(b"numbers")
    (folder / "notes.py").write_text("nobody imports this\n")
    return folder


@pytest.mark.parametrize("spec", ["idm", "idm-e", "pdm", "tsbench.planners.idm:Idm", "tsbench.planners.idm:Idm-e"])
def test_the_scoring_number_speaks_for_our_own_planners(spec: str) -> None:
    assert describe(spec).code_sha256 is None
    assert comes_with_tsbench(spec)


@pytest.mark.parametrize("spec", ["mine.py:P", "tsbench.evil.py:P", "tsbench_mine:P", "no-such", "exe:tsbench.x"])
def test_others_have_hashes_of_their_own(spec: str) -> None:
    assert not comes_with_tsbench(spec)


def test_an_expert_has_the_hash_of_the_planner_that_it_is_made_of(mine: Path) -> None:
    file = mine / "planner.py"
    assert describe(f"{file}:drive-e").code_sha256 == describe(f"{file}:drive").code_sha256 is not None


@pytest.mark.parametrize(
    ("name", "text", "same"),
    [
        ("planner.py", f"# remark\n{MINE}", False),
        ("planner.py", f'"""Gain 2."""\n{MINE}', False),
        ("planner.py", MINE.replace("o)", "o, p=1)"), False),
        ("neighbour.py", "ACCELERATION = 1.0\n", False),
        ("kit/__init__.py", "import math\n", False),
        ("kit/more.py", "STEERING = 0.1\n", False),
        ("net.npz", "other numbers", False),
        ("notes.py", "NOTHING = 1\n", True),
    ],
)
def test_a_planner_of_ones_own_is_its_file_with_all_that_lies_beside_it(
    mine: Path, name: str, text: str, same: bool
) -> None:
    spec = f"{mine / 'planner.py'}:drive"
    before = describe(spec).code_sha256
    (mine / name).write_text(text)
    assert (describe(spec).code_sha256 == before) is same


def test_weights_that_are_named_from_the_folder_of_the_run(
    mine: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = f"{mine / 'planner.py'}:drive"
    (mine / "net.npz").unlink()
    codes = [describe(spec).code_sha256]
    for content in (b"one", b"two"):
        (tmp_path / "net.npz").write_bytes(content)
        codes.append(describe(spec).code_sha256)
    assert len(set(codes)) == 3


def test_a_planner_that_changed_since_its_run_began_is_not_loaded(mine: Path) -> None:
    planner = describe(f"{mine / 'planner.py'}:drive")
    assert resolve_unchanged(planner).name == "drive"
    (mine / "neighbour.py").write_text("ACCELERATION = 1.0\n")
    with pytest.raises(InputError, match="its code has changed since the run began"):
        resolve_unchanged(planner)


def test_a_file_that_it_opened_and_that_changed_is_named(mine: Path) -> None:
    file = mine / "planner.py"
    file.write_text(f"open(__file__.replace('planner.py', 'settings.txt')).close()\n{file.read_text()}")
    (mine / "settings.txt").write_text("one")
    planner = describe(f"{file}:drive")
    assert [line.partition("  ")[2] for line in planner.opened] == ["settings.txt"]
    (mine / "settings.txt").write_text("two")
    with pytest.raises(InputError, match=r"settings\.txt has changed since the run began"):
        resolve_unchanged(planner)


def test_a_module_is_hashed_like_a_file(mine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(mine.parent))
    (mine / "__init__.py").touch()
    (mine / "planner.py").write_text(
        MINE.replace("import neighbour", "from hashed import neighbour").replace("from kit", "from hashed.kit")
    )
    before = describe("hashed.planner:drive").code_sha256
    (mine / "kit" / "more.py").write_text("STEERING = 0.2\n")
    assert describe("hashed.planner:drive").code_sha256 != before


@pytest.mark.parametrize(
    ("code", "command"),
    [
        ("import stable_baselines3.no_such", "pip install 'tsbench[learn]'"),
        ("import no_such_package.part", "pip install no-such-package"),
        ("def __init__(self): import tensorboard.no_such", "pip install 'tsbench[learn]'"),
        ("def __init__(self): import no_such_package", "pip install no-such-package"),
    ],
)
def test_what_a_planner_lacks_is_named_with_what_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, command: str
) -> None:
    for package in ("stable_baselines3", "tensorboard"):
        # As where the extra is not installed.
        monkeypatch.setitem(sys.modules, package, None)
    lines = [f"    {code}"] if code.startswith("def") else []
    text = "" if lines else f"{code}\n"
    text += "\n".join(["class P:", *lines, "    def reset(self, context): ...", "    def act(self, o): ..."])
    (tmp_path / "lacking.py").write_text(text)
    with one_line(command, "lacking.py"):
        describe(f"{tmp_path / 'lacking.py'}:P")


def test_a_planner_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    text = "class P:\n    def __init__(self): raise SystemExit('no licence')\n"
    (tmp_path / "unmade.py").write_text(f"{text}    def reset(self, c): ...\n    def act(self, o): ...\n")
    with pytest.raises(InputError, match=r"cannot be made: SystemExit: no licence .*unmade\.py, line 2"):
        describe(f"{tmp_path / 'unmade.py'}:P")


def called(name: str, spec: str) -> PlannerInfo:
    return PlannerInfo(name, spec, False, True, (), None, None)


def test_names_in_records_are_distinct_and_seen() -> None:
    plain = [called("idm", "idm"), called("规划器", "a.py:规划器")]
    assert distinct(plain) == tuple(plain)
    with pytest.raises(InputError, match=r"--planner b.py:idm: called idm in records, like idm: rename one"):
        distinct([*plain, called("idm", "b.py:idm")])
    with pytest.raises(InputError, match=r"--planner b.py:X: its name: .* mixes scripts .*: rename it"):
        distinct([*plain, called("\u0456dm", "b.py:X")])
