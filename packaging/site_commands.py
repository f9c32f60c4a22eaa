"""`reference/commands.md` of the site: all commands with all their options, made from the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import cleandoc

import click

from tsbench.cli import SECTIONS, cli

_HEAD = """# Commands

Every command with all its arguments and options. This page is made from the code when the site is built, so it says
what `tsbench COMMAND --help` says. Options that repeat can stay in a file: [`tsbench.toml`](../run.md#tsbenchtoml).

Exit codes: 0 done, 1 finished with errors or holes, 2 wrong input, 130 interrupted.
"""


def commands_page() -> str:
    """The page as Markdown."""
    parts = [_HEAD]
    top = click.Context(cli, info_name="tsbench")
    for section, names in SECTIONS.items():
        parts.append(f"## {section}\n")
        for name in names:
            command = cli.get_command(top, name)
            assert command is not None, name
            parts.extend(_described(command, click.Context(command, info_name=name, parent=top)))
    return "\n".join(parts)


def leaves(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    """A command, or all commands of a group."""
    if not isinstance(command, click.Group):
        yield command, context
        return
    for name in command.list_commands(context):
        below = command.get_command(context, name)
        assert below is not None, name
        yield from leaves(below, click.Context(below, info_name=name, parent=context))


def _described(command: click.Command, context: click.Context) -> Iterator[str]:
    for leaf, below in leaves(command, context):
        usage = " ".join([below.command_path, *leaf.collect_usage_pieces(below)])
        yield f"### {below.command_path}\n\n{_described_in(leaf.help or '')}\n\n```\n{usage}\n```\n"
        # What the usage line names may have no help.
        rows = [record for p in leaf.params if (record := p.get_help_record(below)) and record[1]]
        if rows:
            body = "".join(f"| `{option}` | {_cell(_plain(text))} |\n" for option, text in rows)
            yield f"| option | what it does |\n|---|---|\n{body}"


def _described_in(text: str) -> str:
    """A command's help: paragraphs that click leaves as they are (after a line `\\b`) are code."""
    parts = cleandoc(text).replace("\f", "").split("\n\n")
    return "\n\n".join(f"```\n{p[2:]}\n```" if p.startswith("\b\n") else _plain(p) for p in parts)


def _plain(text: str) -> str:
    """Nothing in it is HTML."""
    return cleandoc(text).replace("<", "&lt;").replace(">", "&gt;")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
