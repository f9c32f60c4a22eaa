"""A command of tsbench run within this process, and how it refuses."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tsbench.cli import main

Command = Callable[..., tuple[str, str]]


def in_process(name: str, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs `tsbench NAME ARGUMENTS`: (stdout, stderr). expect: the exit code that it has to end with."""

    def command(*arguments: str, expect: int = 0) -> tuple[str, str]:
        with pytest.raises(SystemExit) as ended:
            main([name, *arguments])
        told = capsys.readouterr()
        assert ended.value.code == expect, told
        return told.out, told.err

    return command


def refused(run: Command, *arguments: str) -> str:
    """The one line with which a command refuses its input."""
    out, err = run(*arguments, expect=2)
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err
