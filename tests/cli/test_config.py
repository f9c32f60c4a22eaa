"""`tsbench.toml`: options of commands, given once; the command line goes before; errors are one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tsbench.cli import main

FILE = """
[run]
planner = ["idm"]
split = "dev"
types = ["yield", "speed_limit"]
variants = "0"
workers = 1
out = "from-file"
"""


def told(folder: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads((folder / "run.json").read_text())["asked"]
    return found


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def called(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    code = ended.value.code
    assert isinstance(code, int)
    return code


def test_a_run_from_the_file_alone(here: Path) -> None:
    (here / "tsbench.toml").write_text(FILE)
    assert called("run") == 0
    asked = told(here / "from-file")
    assert (asked["planners"], asked["split"], asked["types"]) == (["idm"], "dev", ["yield", "speed_limit"])


def test_the_command_line_goes_before(here: Path) -> None:
    (here / "tsbench.toml").write_text(FILE)
    assert called("run", "--types", "stop", "--out", "mine") == 0
    assert told(here / "mine")["types"] == ["stop"]
    assert not (here / "from-file").exists()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[run]\nplaner = 1\n", "tsbench.toml: [run] planer: no such option; there are"),
        ("run = 3\n", "tsbench.toml: run: expected a section, [run]"),
        ("[run\n", "tsbench.toml: is not TOML"),
        ("[run]\nplanner = []\n", "tsbench.toml: [run] planner: expected a value, or a list of values"),
        ("[run]\nplanner = 'idm'\nsplit = 'moon'\n", "Invalid value for '--split'"),
    ],
)
def test_what_is_wrong_is_one_line(
    text: str, problem: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "tsbench.toml").write_text(text)
    assert called("run") == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert problem in error
    assert error.count("\n") == 1


def test_other_commands_do_not_mind_another_section(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "tsbench.toml").write_text("[run]\nplaner = 1\n")
    assert called("signs", "list") == 0
    assert "2.4" in capsys.readouterr().out
