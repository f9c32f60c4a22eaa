"""`tsbench.toml`: options of commands, in the folder where they are given. Source: docs/run.md, "tsbench.toml"."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from tsbench.core.errors import InputError
from tsbench.run.options import TOML, toml_section

# What is judged here may come with a file of its own.
_TAKE_NOTHING = ("submit", "verify", "leaderboard")


def defaults_of(command: click.Command, words: Sequence[str], path: Path = TOML) -> dict[str, Any]:
    """What the file says of a command's options, for `Context.default_map`; nothing where there is no file.

    words: the command's section, and what follows it on the command line. A group's section has a section for each of
    its commands; its other keys hold for every command of the group that has such an option. Only the command that is
    called is looked at. Raises InputError for a file that is no TOML, for what is no option, and for a section of a
    command that takes none.
    """
    name, *rest = words
    section = toml_section(path, name)
    if name in _TAKE_NOTHING:
        if section != {}:
            raise InputError(f"{path}: [{name}]: options of this command are given on the command line only")
        return {}
    section = _table(section, path, name)
    if not isinstance(command, click.Group):
        return given_options(command, section, f"{path}: [{name}]")
    called = rest[0] if rest else ""
    if called not in command.commands:
        return {}
    own = _table(section.get(called, {}), path, f"{name}.{called}")
    for_all = {key: value for key, value in section.items() if key not in command.commands}
    known = {key for one in command.commands.values() for key in _known(one)}
    if unknown := sorted(set(for_all) - known):
        raise InputError(
            f"{path}: [{name}] {unknown[0]}: no command of `tsbench {name}` has this option; commands are "
            f"{', '.join(sorted(command.commands))}"
        )
    asked = command.commands[called]
    found = given_options(asked, {k: v for k, v in for_all.items() if k in _known(asked)}, f"{path}: [{name}]")
    return {called: {**found, **given_options(asked, own, f"{path}: [{name}.{called}]")}}


def telling(command: click.Command) -> click.Command:
    """The command, which says before it begins what it takes from the file."""
    told = copy(command)
    if isinstance(command, click.Group) and isinstance(told, click.Group):
        told.commands = {name: telling(one) for name, one in command.commands.items()}
    elif (callback := command.callback) is not None:

        def tell_and_call(*args: Any, **kwargs: Any) -> Any:
            context = click.get_current_context()
            tell(
                long_name(option)
                for option in _known(command).values()
                if context.get_parameter_source(option.name or "") is ParameterSource.DEFAULT_MAP
            )
            return callback(*args, **kwargs)

        told.callback = tell_and_call
    return told


def tell(options: Iterable[str]) -> None:
    """Say on standard error which options the file gave, where it gave any."""
    if names := ", ".join(options):
        click.echo(f"{TOML}: {names}", err=True)


def long_name(option: click.Option) -> str:
    """An option as the command line spells it, without the dashes."""
    return max(option.opts, key=len).lstrip("-")


def _table(value: Any, path: Path, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{path}: {name}: expected a section, [{name}]")
    return value


def _known(command: click.Command) -> dict[str, click.Option]:
    return {long_name(p): p for p in command.params if isinstance(p, click.Option)}


def given_options(command: click.Command, section: Mapping[str, Any], where: str) -> dict[str, Any]:
    """What a mapping in a file says of a command's options, for `Context.default_map`.

    Raises InputError, which begins with `where`, for what is no option and for what no option takes.
    """
    known = _known(command)
    found: dict[str, Any] = {}
    for key, value in section.items():
        option = known.get(key)
        if option is None or option.name is None:
            raise InputError(f"{where} {key}: no such option; there are {', '.join(sorted(known)) or 'none'}")
        found[option.name] = _as_given(option, value, f"{where} {key}")
    return found


def _as_given(option: click.Option, value: Any, where: str) -> Any:
    """A value as the command line would give it: text, several of it where the option takes several."""
    if option.is_flag:
        if not isinstance(value, bool):
            raise InputError(f"{where}: expected true or false")
        return value
    values = value if isinstance(value, list) else [value]
    if not values or any(isinstance(v, dict | list | bool) for v in values):
        raise InputError(f"{where}: expected a value, or a list of values")
    texts = [str(v) for v in values]
    if option.multiple:
        return texts
    if option.nargs > 1:
        if len(texts) != option.nargs:
            raise InputError(f"{where}: expected a list of {option.nargs} values")
        return texts
    return ",".join(texts)
