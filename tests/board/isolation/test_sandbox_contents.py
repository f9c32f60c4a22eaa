"""What a planner is shown of its own folder: copies of the regular files in it, and nothing else."""

from __future__ import annotations

import os
import py_compile
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tsbench.board.isolation import sandbox_contents as files
from tsbench.board.isolation.isolated_loading import changed_files, describe, load
from tsbench.board.isolation.process import PlannerProcess
from tsbench.board.isolation.sandbox_contents import PlannerFiles, is_installed, is_public
from tsbench.core.errors import InputError
from tsbench.planners.base import PlannerContext
from tsbench.run import opened_files
from tsbench.run.planner_info import code_hash_of

PLANNER = "class P:\n    floor = False\n    def reset(self, c): pass\n    def act(self, o): pass\n"


def shown(spec: str) -> dict[str, str]:
    """What stands in the sandbox, by the path there."""
    own, found = PlannerFiles(spec), {}
    for copy, place in own.binds:
        for path in [copy] if copy.is_file() else sorted(copy.rglob("*")):
            found[str(place / path.relative_to(copy))] = path.read_text() if path.is_file() else "a folder"
    own.remove()
    return found


@pytest.mark.parametrize("line", ["import beside_the_sandbox", "import beside_the_sandbox.deep as deep"])
def test_a_package_that_only_pythonpath_has_is_named(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, place = tmp_path / "checkout" / "beside_the_sandbox", tmp_path / "planner"
    package.mkdir(parents=True)
    place.mkdir()
    for name in ("__init__.py", "deep.py"):
        (package / name).touch()
    (place / "mine.py").write_text(f"{line}\n{PLANNER}")
    monkeypatch.syspath_prepend(package.parent)
    with pytest.raises(InputError, match=rf"not {package}: install it with pip, or copy it beside the planner's file$"):
        describe(f"{place}/mine.py:P")
    package.rename(place / package.name)
    assert describe(f"{place}/mine.py:P").planner.name == "P"


def test_regular_files_are_shown_and_nothing_else(tmp_path: Path) -> None:
    place = tmp_path / "planner"
    for name in ("deep", "__pycache__", ".git", "env"):
        (place / name).mkdir(parents=True)
    kept = {"mine.py": PLANNER, "weights": "1", "deep/data.txt": "2"}
    for name, content in kept.items():
        (place / name).write_text(content)
    (place / "__pycache__" / "mine.pyc").touch()
    (place / ".git" / "config").touch()
    (place / ".token").touch()
    (place / "env" / "pyvenv.cfg").touch()
    (tmp_path / "secret").touch()
    (place / "away").symlink_to(tmp_path / "secret")
    (place / "deep" / "up").symlink_to(tmp_path)
    os.mkfifo(place / "pipe")
    with socket.socket(socket.AF_UNIX) as line:
        line.bind(os.path.relpath(place / "socket"))
        found = shown(f"{place}/mine.py:P")
    assert found.pop(str(place / "deep")) == "a folder"
    assert found == {str(place / name): content for name, content in kept.items()}


def test_what_is_mounted_in_the_folder_is_not_shown(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "mine.py").write_text(PLANNER)
    code = (
        "import sys; from tsbench.board.isolation.sandbox_contents import PlannerFiles; "
        "own = PlannerFiles(sys.argv[1]); print([path.name for copy, _ in own.binds for path in copy.rglob('*')])"
    )
    mounted = 'mount -t tmpfs none "$1/other" && touch "$1/other/secret" || exit 9; shift; exec "$@"'
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", mounted, "sh", str(tmp_path), sys.executable, "-c", code,
         f"{tmp_path}/mine.py:P"],
        capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    if done.returncode in (1, 9):
        pytest.skip(f"nothing can be mounted here: {done.stderr}")
    assert done.stdout == "['mine.py']\n", done.stderr


@pytest.mark.parametrize("kind", ["temporary", "home", "above home"])
def test_at_the_top_of_a_shared_folder_only_named_files_are_shown(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if kind == "temporary":
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    else:
        monkeypatch.setenv("HOME", str(tmp_path / "me" if kind == "above home" else tmp_path))
    (tmp_path / "mine.py").write_text(f"import helper\nWEIGHTS = 'mine.json'\n{PLANNER}")
    for name in ("helper.py", "mine.json", "diary.txt"):
        (tmp_path / name).touch()
    assert {Path(name).name for name in shown(f"{tmp_path}/mine.py:P")} == {"mine.py", "helper.py", "mine.json"}


def test_a_program_is_shown_alone(tmp_path: Path) -> None:
    for name in ("program", "beside"):
        (tmp_path / name).write_text(name)
    assert shown(f"exe:{tmp_path}/program") == {f"{tmp_path}/program": "program"}


def test_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(3):
        (tmp_path / f"{k}.py").write_text(PLANNER)
    assert len(shown(f"{tmp_path}/0.py:P")) == 3
    for limit, most in (("_MOST_FILES", 2), ("_MOST_BYTES", 10)):
        with monkeypatch.context() as patch:
            patch.setattr(files, limit, most)
            with pytest.raises(InputError, match="give the planner a folder of its own"):
                PlannerFiles(f"{tmp_path}/0.py:P")


def test_whoever_the_planner_is_in_its_sandbox_can_read_the_copies(tmp_path: Path) -> None:
    (tmp_path / "planner" / "deep").mkdir(parents=True)
    (tmp_path / "planner" / "mine.py").write_text(PLANNER)
    (tmp_path / "planner" / "deep" / "data.txt").touch()
    before = os.umask(0o077)
    try:
        own = PlannerFiles(f"{tmp_path}/planner/mine.py:P")
    finally:
        os.umask(before)
    ((copy, _),) = own.binds
    assert all(is_public(path) for path in (copy, *copy.rglob("*")))


def test_a_folder_below_the_prefix_of_python_is_not_installed() -> None:
    """The planner's files in /usr/src are its own: an image has none of them."""
    assert is_installed(Path(pytest.__file__))
    assert is_installed(Path(files.__file__))
    assert not is_installed(Path(sys.base_prefix, "src", "planner"))
    assert not is_installed(Path(sys.prefix, "src", "planner"))


def test_what_comes_with_tsbench_for_root_alone_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "is_of_tsbench", lambda _: True)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    (tmp_path / "mine.py").write_text(PLANNER)
    tmp_path.chmod(0o755)
    assert PlannerFiles(f"{tmp_path}/mine.py:P").binds == []
    tmp_path.chmod(0o700)
    with pytest.raises(InputError, match=r"only its owner may read .*chmod -R go"):
        PlannerFiles(f"{tmp_path}/mine.py:P")


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder where packages are installed."""
    monkeypatch.setattr(files, "getsitepackages", lambda: [str(tmp_path)])
    monkeypatch.setattr(files, "_PYTHON", (*files._PYTHON, str(tmp_path)))
    monkeypatch.syspath_prepend(tmp_path)
    tmp_path.chmod(0o755)
    return tmp_path


# Its file where it is installed, and how it is named: a package, a module, one in a namespace.
INSTALLED = {"mine:P": "mine/__init__.py", "mine2:P": "mine2.py", "space.mine:P": "space/mine.py"}


@pytest.mark.parametrize("spec", INSTALLED)
def test_an_installed_planner_runs_and_sees_what_has_a_hash(spec: str, site: Path) -> None:
    """It may come with a cache that says other things than its code."""
    source = site / INSTALLED[spec]
    source.parent.mkdir(exist_ok=True)
    source.write_text(PLANNER.replace("False", "True"))
    py_compile.compile(str(source), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    source.write_text(PLANNER)
    planner = describe(spec).planner
    assert not planner.floor
    assert opened_files.names(planner.files) == [source.name]


def test_a_verification_sees_of_an_installed_package_what_was_claimed(site: Path) -> None:
    source = site / "mine" / "__init__.py"
    source.parent.mkdir()
    seen = [source.with_name(".hidden"), source.with_name("later")]
    looks = f"any(map(Path.exists, map(Path, {[str(path) for path in seen]})))"
    source.write_text(f"from pathlib import Path\n{PLANNER.replace('False', looks)}")
    claimed = describe("mine:P").planner
    for path in seen:
        path.touch()
    assert describe("mine:P", only=claimed.files).planner == claimed


def test_all_sandboxes_of_a_worker_have_the_same_files(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(PLANNER)
    spec = f"{file}:P"
    own = PlannerFiles(spec)
    file.write_text(PLANNER.replace("False", "True"))
    told = []
    for copied in (own, None):
        process = PlannerProcess(spec, (), copied)
        told.append(process.facts.floor)
        process.close()
    assert told == [False, True]


def file_pair(folder: Path) -> tuple[Path, Path]:
    """A planner whose gain is in its docstring, and a module that holds weights as text."""
    file, weights = folder / "mine.py", folder / "policy.py"
    file.write_text(f'"""Gain 1."""\n{PLANNER}')
    weights.write_text("1")
    return file, weights


@pytest.mark.parametrize(
    "edit",
    [
        lambda file, _: file.write_text(file.read_text().replace("Gain 1", "Gain 2")),
        lambda file, _: file.write_text(f"\n{file.read_text()}"),
        lambda _, weights: weights.write_text("2"),
        lambda _, weights: weights.chmod(0o755),
        lambda _, weights: weights.unlink(),
    ],
    ids=["docstring", "line numbers", "data in .py", "mode", "gone"],
)
def test_each_byte_that_a_sandbox_shows_is_in_the_hash(tmp_path: Path, edit: Callable[[Path, Path], object]) -> None:
    file, weights = file_pair(tmp_path)
    planner = describe(f"{file}:P").planner
    assert opened_files.names(planner.files) == ["mine.py", "policy.py"]
    assert not changed_files(f"{file}:P", planner)
    edit(file, weights)
    (changed,) = changed_files(f"{file}:P", planner)
    context = PlannerContext.__new__(PlannerContext)
    with pytest.raises(InputError, match=f"{changed} has changed since the run began"):
        load(planner).factory().reset(context)


def test_all_kinds_of_files_are_hashed(tmp_path: Path) -> None:
    file, _ = file_pair(tmp_path)
    kinds = ["a.dist-info/w", "a.so", "b.pyc", "mine.py", "policy.py"]
    for name in kinds[:3]:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert opened_files.names(PlannerFiles(f"{file}:P").lines) == kinds


def test_files_that_a_run_did_not_have_are_not_shown(tmp_path: Path) -> None:
    file, _ = file_pair(tmp_path)
    planner = describe(f"{file}:P").planner
    (tmp_path / "secret.json").touch()
    assert describe(f"{file}:P", only=planner.files).planner == planner
    assert not changed_files(f"{file}:P", planner)
    assert describe(f"{file}:P").planner != planner


def test_what_no_sandbox_shows_is_not_hashed(tmp_path: Path) -> None:
    file, _ = file_pair(tmp_path)
    before = PlannerFiles(f"{file}:P").lines
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "mine.cpython-311.pyc").touch()
    (tmp_path / ".notes").touch()
    (tmp_path / "link").symlink_to("/etc/passwd")
    assert PlannerFiles(f"{file}:P").lines == before


def test_a_folder_that_is_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    file, _ = file_pair(tmp_path)
    with (tmp_path / "net.bin").open("wb") as sparse:
        sparse.truncate(1 << 40)
    with pytest.raises(InputError, match="8 GiB"):
        describe(f"{file}:P")
    with pytest.raises(InputError, match="8 GiB"):
        describe(f"exe:{(tmp_path / 'net.bin').rename(tmp_path / 'program')}")
    (tmp_path / "program").chmod(0o755)
    with pytest.raises(InputError, match="8 GiB"):
        code_hash_of(f"exe:{tmp_path / 'program'}")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="no file that can be executed"):
        code_hash_of(f"exe:{tmp_path / 'pipe'}")
