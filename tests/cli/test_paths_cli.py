"""`~` in paths: a shell leaves that of `--out=~/x` as it is, so tsbench expands it, wherever a path is given."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from command_line import commands, in_process, refused

import tsbench
from tsbench.api.evaluate import spec_of
from tsbench.cli import cli
from tsbench.core.errors import InputError
from tsbench.core.paths import expanded, expanded_text
from tsbench.learn.envs.drive_env import DriveEnv

# What says that words may begin with a path.
PATH_WORDS = ("FILE", "DIR", "PATH", "RUN", "PLANNER", "SPEC", "file.py")


def path_parameters() -> list[tuple[str, click.Parameter]]:
    """All options and arguments that take a path, or words that may begin with one."""
    found = []
    for words, command in commands(cli):
        for parameter in command.params:
            shown = parameter.metavar or (parameter.name or "").upper()
            takes_path = isinstance(parameter.type, click.Path)
            is_text = isinstance(parameter.type, click.types.StringParamType)
            # Names that records know planners by are no files.
            is_name = words == "submit" or words.startswith("train measure")
            if takes_path or (is_text and not is_name and any(word in shown for word in PATH_WORDS)):
                found.append((f"{words} {parameter.opts[0]}", parameter))
    return found


FOUND = path_parameters()


def test_the_walk_finds_options_of_all_kinds() -> None:
    names = {name for name, _ in FOUND}
    assert {"run --out", "run --perception", "compare run_a", "data fetch --from", "seal secret file"} <= names
    assert len(names) > 80


@pytest.mark.parametrize(("name", "parameter"), FOUND, ids=[name for name, _ in FOUND])
def test_the_home_folder(name: str, parameter: click.Parameter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/of-a-test")
    found = parameter.type.convert("~/of mine", parameter, click.Context(cli))
    assert str(found) == "/home/of-a-test/of mine"


def test_what_is_no_home_folder_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/of-a-test")
    assert expanded("a/~/b") == Path("a/~/b")
    assert expanded("~no-such-user-of-this-machine/b") == Path("~no-such-user-of-this-machine/b")
    assert expanded_text("idm") == "idm"
    assert expanded_text("pkg.module:Class") == "pkg.module:Class"
    assert expanded_text("http://host/~someone/") == "http://host/~someone/"
    assert expanded_text("exe:~/drive") == "exe:/home/of-a-test/drive"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.chdir(tmp_path)
    return folder


def test_a_file_is_written_below_it(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    in_process("seal", capsys)("secret", "~/secret")
    assert (home / "secret").is_file()
    assert not (home.parent / "~").exists()


def test_a_default_of_the_folder(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (home.parent / "tsbench.toml").write_text('[run]\nout = "~/taken"\n')
    (home / "taken").write_text("a file")
    told = refused(in_process("run", capsys), "--planner", "idm", "--split", "dev", "--limit", "1")
    assert f"{home / 'taken'}" in told


def test_calls_from_python(home: Path) -> None:
    (home / "taken").write_text("a file")
    assert spec_of("~/mine.py:Mine") == f"{home}/mine.py:Mine"
    with pytest.raises(InputError, match=f"{home}/none"):
        tsbench.load_run("~/none")
    with pytest.raises(InputError, match=f"{home}/taken"):
        tsbench.evaluate("idm", split="dev", limit=1, out="~/taken")
    with pytest.raises(InputError, match=f"{home}/level.yaml"):
        tsbench.evaluate("idm", split="dev", limit=1, perception="~/level.yaml")
    with pytest.raises(InputError, match=f"{home}/level.yaml"):
        DriveEnv(split="dev", perception="~/level.yaml")
