"""A planner is known by what it opens while it is made, however it finds the name."""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
from pathlib import Path

import pytest

from tsbench.run import opened_files
from tsbench.run.planner_info import describe

# No string of it is the name of a file.
MINE = """
from pathlib import Path
from tsbench import Control

HERE = Path(__file__).parent

class Mine:
    def __init__(self):
        self.a = float((HERE / ("ne" + "t.txt")).read_text())
        Path("made.txt").write_text("by itself")
        Path("made.txt").read_text()
        Path("/proc/self/stat").read_text()

    def reset(self, context): pass
    def act(self, o): return Control(self.a, 0.0)
"""


def line(content: bytes, name: object) -> str:
    return f"{hashlib.sha256(content).hexdigest()}  {name}"


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "opener.py").write_text(MINE)
    (folder / "net.txt").write_text("0.5")
    monkeypatch.chdir(tmp_path)
    return f"{folder / 'opener.py'}:Mine"


def test_a_file_with_a_computed_name_counts_and_nothing_else_does(mine: str) -> None:
    before = describe(mine)
    assert before.opened == (line(b"0.5", "net.txt"),)
    Path("mine/net.txt").write_text("0.25")
    after = describe(mine)
    assert after.opened == (line(b"0.25", "net.txt"),)
    # The code is the same, which is what a hash of code says.
    assert after.code_sha256 == before.code_sha256


def test_a_large_library_of_code_is_no_list_of_files(mine: str) -> None:
    folder = Path("mine/large")
    folder.mkdir()
    for number in range(1100):
        (folder / f"part_{number}.py").touch()
    code = Path("mine/opener.py")
    lines = "".join(f"import large.part_{number}\n" for number in range(1100))
    code.write_text(f"{lines}{MINE}")
    assert describe(mine).opened == (line(b"0.5", "net.txt"),)


def test_an_environment_in_the_planner_s_folder_is_not_the_planner_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside = tmp_path / ".venv" / "lib" / "site-packages" / "plots" / "style.txt"
    inside.parent.mkdir(parents=True)
    inside.write_text("style")
    (tmp_path / "net.txt").write_text("net")
    monkeypatch.setattr(sys, "prefix", str(tmp_path / ".venv"))
    opened_files._of_others.cache_clear()
    try:
        files = [str(inside), str(tmp_path / "net.txt")]
        assert opened_files.hashes(files, tmp_path) == (line(b"net", "net.txt"),)
        # A planner that is installed there has files of its own in it.
        assert opened_files.hashes(files, inside.parent) == (
            line(b"net", tmp_path / "net.txt"), line(b"style", "style.txt")
        )  # fmt: skip
    finally:
        opened_files._of_others.cache_clear()


def test_lines_that_are_none_have_no_names() -> None:
    assert opened_files.names(["ab  b", "ab  a  c", "ab  b", "x"]) == ["", "a  c", "b"]


def test_the_package_s_own_planners_are_known_by_contract_and_code() -> None:
    for name in ("idm", "reader"):
        assert describe(name).opened == describe(name).unseen == ()


def test_read_and_written_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("before", "read", "changed"):
        Path(name).write_text(name)
    Path("before").read_text()
    Path("away/deep").mkdir(parents=True)
    Path("away/read").write_text("another")
    Path("link").symlink_to("away/deep")
    with opened_files.noted() as opened:
        os.close(os.open(b"./read", os.O_RDONLY))
        with Path("changed").open("r+") as file:
            file.read()
        Path("new").write_text("new")
        Path("new").read_text()
        assert not Path("missing").exists()
        Path("link/../read").read_text()
    Path("before").read_text()
    assert [file for file in opened.files if file.startswith(str(tmp_path))] == [
        str(tmp_path / name) for name in ("away/read", "read")
    ]


@pytest.mark.parametrize("name", ["policy.py", "policy.so", "policy.pyc", "a.dist-info/policy"])
def test_weights_count_whatever_their_name(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("0.5")
    (tmp_path / "imported_once.py").write_text("")
    with opened_files.noted() as opened, pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        importlib.import_module("imported_once")
        file.read_text()
    assert opened_files.hashes(opened.files, tmp_path) == (line(b"0.5", name),)


def test_a_failed_block_ends_the_notes(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), opened_files.noted() as opened:
        raise ZeroDivisionError
    assert opened.files == ()
    (tmp_path / "later").write_text("")
    (tmp_path / "later").read_text()
    assert opened.files == ()


def test_files_elsewhere_are_named_by_their_path_unless_they_are_somebody_else_s(tmp_path: Path) -> None:
    place, away = tmp_path / "mine", tmp_path / "away.npz"
    place.mkdir()
    (place / "a.npz").write_bytes(b"a")
    (place / "link").symlink_to("a.npz")
    (place / "out").symlink_to(away)
    away.write_bytes(b"away")
    os.mkfifo(place / "pipe")
    wanted = [place / "a.npz", place / "link", place / "out", place / "pipe", place / "gone", Path("/etc/passwd"),
              Path(os.__file__), Path(np_file()), place / "code.pyc", Path(opened_files.__file__)]  # fmt: skip
    files = list(map(str, wanted))
    both = (line(b"away", away), line(b"a", "a.npz"))
    assert opened_files.hashes(files, place) == both
    assert opened_files.hashes(files, None) == (both[0], line(b"a", place / "a.npz"))


def test_no_manifest_tells_whose_home_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "net.npz").write_bytes(b"net")
    assert opened_files.hashes([str(tmp_path / "net.npz")], None) == (line(b"net", "~/net.npz"),)


def np_file() -> str:
    """A text of an installed package."""
    import numpy as np

    return str(Path(np.__file__).with_name("py.typed"))


def test_a_package_s_folder_is_its_outermost(tmp_path: Path) -> None:
    inner = tmp_path / "kit" / "nets"
    inner.mkdir(parents=True)
    for folder in (inner, inner.parent):
        (folder / "__init__.py").touch()
    assert opened_files.place_of(inner / "planner.py") == tmp_path / "kit"
    assert opened_files.place_of(tmp_path / "planner.py") == tmp_path
    assert opened_files.place_of(tmp_path / "site-packages" / "planner.py") is None
    assert opened_files.place_of(Path(opened_files.__file__)) is None


def test_packages_with_code_that_python_does_not_see_are_named(tmp_path: Path) -> None:
    gone = {name for name in sys.modules if name.partition(".")[0] == "safetensors"}
    kept = {name: sys.modules.pop(name) for name in gone}
    try:
        with opened_files.noted() as opened:
            import safetensors  # noqa: F401
    finally:
        sys.modules.update(kept)
    assert opened.unseen == ("safetensors",)
