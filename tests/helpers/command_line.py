"""All commands of tsbench, a command run within this process, and how it refuses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click
import pytest

from tsbench.cli import main
from tsbench.core.errors import InputError

Command = Callable[..., tuple[str, str]]


def commands(command: click.Command, words: str = "") -> Iterator[tuple[str, click.Command]]:
    """Those of a group and of the groups in it, each with the words that call it."""
    if not isinstance(command, click.Group):
        yield words, command
        return
    context = click.Context(command)
    for name in command.list_commands(context):
        below = command.get_command(context, name)
        assert below is not None
        yield from commands(below, f"{words} {name}".strip())


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


@contextmanager
def one_line(*words: str, match: str | None = None, kind: type[Exception] = InputError) -> Iterator[list[str]]:
    """The block raises an error of one line, which is given. words: what the line has; match: a pattern of it."""
    said: list[str] = []
    with pytest.raises(kind, match=match) as told:
        yield said
    said.append(str(told.value))
    assert "\n" not in said[0]
    assert all(word in said[0] for word in words), said
