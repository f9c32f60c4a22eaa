"""Every `tsbench …` command that a page shows exists, and so do its options and the choices that it gives."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from tsbench.cli import cli

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```[^\n]*\n(.*?)^```", re.M | re.S)
_SHELL = re.compile(r"^\s*(?:[A-Z_]+=\S+ )*(?:\$ )?(?:\S*/)?(tsbench .*)")
_INLINE = re.compile(r"(?<!`)`(tsbench [^`]+)`(?!`)")


def commands(text: str) -> list[str]:
    """Command lines of code blocks, those that go on in the next line as one, and what stands in the text as code."""
    found = []
    for block in _BLOCK.findall(text):
        lines = block.replace("\\\n", " ").splitlines()
        found += [m[1] for line in lines if (m := _SHELL.match(line))]
    found += _INLINE.findall(_BLOCK.sub("", text).replace("\n", " "))
    return [re.split(r"\s#|\s[|>&;]|\s?…|\(|[;:,.]?$", line)[0].strip() for line in found]


def wrong(line: str) -> str | None:
    """What the command line would not know, None where it knows all."""
    command: click.Command = cli
    context = click.Context(cli, info_name="tsbench")
    words = shlex.split(line.replace("'", ""))[1:]  # what was cut off may have had the other quotation mark
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        name = words.pop(0)
        below = command.get_command(context, name)
        if below is None:
            return None if name.isupper() or "/" in name else f"no command {name}"
        command, context = below, click.Context(below, info_name=name, parent=context)
    options = {o: p for p in command.get_params(context) for o in (*p.opts, *p.secondary_opts)}
    for word, value in zip(words, [*words[1:], ""], strict=False):
        option, _, given = word.partition("=")
        if not option.startswith("-") or re.fullmatch(r"-?\d.*", option):
            continue
        if option not in options:
            return f"{context.command_path}: no option {option}"
        kind, given = options[option].type, given or value
        known = set(kind.choices) if isinstance(kind, click.Choice) else None
        if known and given and not given.isupper() and not set(given.split("|")) <= known:
            return f"{context.command_path} {option}: no choice {given}"
    return None


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_of_a_page_exist(page: Path) -> None:
    found = {line: problem for line in commands(page.read_text(encoding="utf-8")) if (problem := wrong(line))}
    assert found == {}


def test_pages_have_commands() -> None:
    assert sum(len(commands(page.read_text(encoding="utf-8"))) for page in PAGES) > 100
