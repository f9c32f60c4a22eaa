"""`tsbench.toml`: options of commands, given once; the command line goes before; errors are one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import pytest
from command_line import in_process, refused

import tsbench
from tsbench.cli import SECTIONS, cli, config, main
from tsbench.core.errors import InputError

FILE = """
[run]
planner = ["idm"]
split = "dev"
types = ["yield", "speed_limit"]
variants = "0"
limit = 2
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


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[run]\nplaner = 1\n", "tsbench.toml: [run] planer: no such option; there are"),
        ("run = 3\n", "tsbench.toml: run: expected a section, [run]"),
        ("[run\n", "tsbench.toml: is not TOML"),
        ("[run]\nplanner = []\n", "tsbench.toml: [run] planner: expected a value, or a list of values"),
        ("[run]\nplanner = 'idm'\nsplit = 'moon'\n", "Invalid value for '--split'"),
        ("[run]\nplanner = 'idm'\nsplit = 'dev'\nworkers = 1.5\n", "Invalid value for '--workers'"),
        ("[run]\nisolate = 'yes'\n", "tsbench.toml: [run] isolate: expected true or false"),
        ("[run]\nworkers = true\n", "tsbench.toml: [run] workers: expected a value, or a list of values"),
    ],
)
def test_what_is_wrong_is_one_line(text: str, problem: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "tsbench.toml").write_text(text)
    assert problem in refused(in_process("run", capsys))


def test_what_is_taken_from_the_file_is_said(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "tsbench.toml").write_text(FILE)
    # What the command line gives is not the file's.
    assert called("run", "--types", "stop", "--out", "mine") == 0
    assert told(here / "mine")["types"] == ["stop"]
    assert not (here / "from-file").exists()
    assert capsys.readouterr().err.splitlines()[0] == "tsbench.toml: planner, split, limit, variants, workers"
    tsbench.evaluate(types="stop", out="mine")
    assert capsys.readouterr().err.splitlines()[0] == "tsbench.toml: planner, split, variants, limit, workers"
    (here / "tsbench.toml").write_text("[signs.equivalents]\ncountry = 'de'\n")
    assert called("signs", "equivalents") == 0
    assert capsys.readouterr().err == "tsbench.toml: country\n"
    assert called("signs", "list") == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (("verify", "x.json", "--seed", "1"), "[verify]\nshared-process = true\n"),
        (("submit", "run", "--authors", "us"), "[submit]\nshared-process = true\n"),
        (("leaderboard", "build", "."), "[leaderboard.build]\nplayers = 1\n"),
    ],
)
def test_what_judges_others_takes_nothing(
    command: tuple[str, ...], text: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "tsbench.toml").write_text(text)
    told = refused(in_process(command[0], capsys), *command[1:])
    assert told == f"error: tsbench.toml: [{command[0]}]: options of this command are given on the command line only\n"
    # Other sections are no business of it.
    (here / "tsbench.toml").write_text("[run]\nworkers = 1\n")
    called(*command)
    assert "tsbench.toml" not in capsys.readouterr().err


GROUP = """
[train]
seed = 7
device = "cuda"
[train.plant2]
seed = 8
epochs = 3
planner = ["idm", "reader"]
[train.ppo]
rate = 0.5
[train.measure]
stop-policy = [0.5, 1, 0.25, 2, 3]
[planners.check]
limit = 4
"""


def of_group(path: Path, *words: str) -> dict[str, Any]:
    command = cli.get_command(click.Context(cli), words[0])
    assert command is not None
    found = config.defaults_of(command, words, path)
    return dict(found.get(words[1], {}))


def test_a_groups_commands_have_sections_of_their_own(here: Path) -> None:
    path = here / "tsbench.toml"
    path.write_text(GROUP)
    assert of_group(path, "train", "plant2", "--batch", "8") == {
        "seed": "8", "device": "cuda", "epochs": "3", "planners": ["idm", "reader"],
    }  # fmt: skip
    assert of_group(path, "train", "ppo") == {"seed": "7", "device": "cuda", "rate": "0.5"}
    # It has no device.
    assert of_group(path, "train", "measure") == {"seed": "7", "stop_policy": ["0.5", "1", "0.25", "2", "3"]}
    assert of_group(path, "planners", "check") == {"limit": "4"}
    assert of_group(path, "planners", "list") == {}


def test_a_groups_options_reach_its_command(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "tsbench.toml").write_text("[signs.equivalents]\ncountry = 'moon'\n")
    # The others do not mind.
    signs = in_process("signs", capsys)
    signs("list")
    signs("equivalents", "--country", "de")
    assert "moon" in refused(signs, "equivalents")


@pytest.mark.parametrize("group", ["train", "planners", "signs", "analyse"])
def test_what_is_wrong_in_a_groups_section_is_one_line(
    group: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert group in {name for section in SECTIONS.values() for name in section}
    command = {"train": "ppo", "planners": "list", "signs": "list", "analyse": "main"}[group]
    for text, problem in (
        (f"[{group}]\nbanana = 1\n", f"[{group}] banana: no command of `tsbench {group}` has this option"),
        (f"[{group}.{command}]\nbanana = 1\n", f"[{group}.{command}] banana: no such option; there are"),
        (f"[{group}]\n{command} = 1\n", f"{group}.{command}: expected a section, [{group}.{command}]"),
    ):
        (here / "tsbench.toml").write_text(text)
        assert refused(in_process(group, capsys), command).startswith(f"error: tsbench.toml: {problem}")
        # Its help can still be read.
        assert called(group, "--help") == 0
        capsys.readouterr()


def test_python_takes_what_the_command_takes(here: Path) -> None:
    (here / "tsbench.toml").write_text(FILE)
    assert called("run") == 0
    asked = told(here / "from-file")
    assert (asked["planners"], asked["split"], asked["types"]) == (["idm"], "dev", ["yield", "speed_limit"])
    # Python shows the same complete run.
    run = tsbench.evaluate()
    assert run.path == Path("from-file")
    assert (run.planners, run.status, run.options["types"]) == (("idm",), "complete", ["yield", "speed_limit"])
    # Arguments go before.
    other = tsbench.evaluate("idm-e", types="stop", limit=1, out="mine")
    assert (other.planners, other.options["types"], other.options["split"]) == (("idm-e",), ["stop"], "dev")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "split: name one (split=…), here or in the section [run] of tsbench.toml"),
        ("[run]\nsplit = 'dev'\n", "planner: name at least one"),
        ("[run]\nplaner = 1\n", "tsbench.toml: [run] planer: no such option; there are"),
        ("[run]\nsplit = 'moon'\n", "tsbench.toml: [run] split moon: expected"),
        ("[run]\nworkers = 1.5\n", "tsbench.toml: [run] workers 1.5: expected a whole number"),
    ],
)
def test_python_says_what_is_wrong(text: str, problem: str, here: Path) -> None:
    (here / "tsbench.toml").write_text(text)
    with pytest.raises(InputError) as raised:
        tsbench.evaluate()
    assert problem in str(raised.value)
