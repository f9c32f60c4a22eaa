"""`tsbench.toml`: options of commands, in the folder where they are given. Source: docs/run.md, "tsbench.toml"."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import click

from tsbench.core.errors import InputError

FILE = Path("tsbench.toml")


def defaults_of(command: click.Command, name: str, path: Path = FILE) -> dict[str, Any]:
    """What the file says of a command's options, for `Context.default_map`; nothing where there is no file.

    name: the command's section. Raises InputError for a file that is no TOML, and for what is no option.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not TOML ({error})") from None
    section = content.get(name, {})
    if not isinstance(section, dict):
        raise InputError(f"{path}: {name}: expected a section, [{name}]")
    known = {long_name(p): p for p in command.params if isinstance(p, click.Option)}
    found: dict[str, Any] = {}
    for key, value in section.items():
        option = known.get(key)
        if option is None or option.name is None:
            raise InputError(f"{path}: [{name}] {key}: no such option; there are {', '.join(sorted(known))}")
        found[option.name] = _as_given(option, value, f"{path}: [{name}] {key}")
    return found


def long_name(option: click.Option) -> str:
    """An option as the command line spells it, without the dashes."""
    return max(option.opts, key=len).lstrip("-")


def _as_given(option: click.Option, value: Any, where: str) -> Any:
    """A value as click takes it: several of an option that may be given several times, words with commas else."""
    values = value if isinstance(value, list) else [value]
    if not values or any(isinstance(v, dict | list) for v in values):
        raise InputError(f"{where}: expected a value, or a list of values")
    if option.multiple:
        return values
    return value if not isinstance(value, list) else ",".join(map(str, values))
