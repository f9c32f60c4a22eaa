"""`python -m tsbench` is the command `tsbench`."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tsbench.cli import main


def as_a_module(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "tsbench", *arguments], capture_output=True, text=True, check=False)


def test_it_prints_the_same_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    shown = as_a_module("--help")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout == capsys.readouterr().out
    assert shown.stdout.startswith("Usage: tsbench [OPTIONS] COMMAND")


def test_it_refuses_with_the_same_line_and_code() -> None:
    refused = as_a_module("run", "--split", "moon", "--planner", "idm")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("error: Invalid value for '--split': 'moon' is not one of")
