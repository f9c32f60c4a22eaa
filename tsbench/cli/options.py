"""Options that several commands share, and how they are read: each stands here once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tsbench.core.errors import InputError
from tsbench.core.machine import own_cores
from tsbench.core.paths import CITY, OWN_CITY, city_names, expanded, expanded_text
from tsbench.episode.perception_level import EXACT
from tsbench.planners.registry import names as registered
from tsbench.run.log.manifest import city_of, read_manifest
from tsbench.run.options import Option as Known
from tsbench.run.options import RunOptions, options_in
from tsbench.run.plan import choose_types, types_and_groups
from tsbench.scenarios.data_set import SPLITS, DataSet
from tsbench.signs.countries import Country, load_country

if TYPE_CHECKING:
    from tsbench.scenarios.spec import ScenarioSpec

Option = Callable[[Callable[..., Any]], Callable[..., Any]]
Completion = Callable[[click.Context, click.Parameter, str], list[str]]
Words = tuple[str, ...]


class UserPath(click.Path):
    """The type of every option that is a path: `~` is the home folder, also in `--out=~/x` and in tsbench.toml."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(path_type=Path, **kwargs)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("is empty: name a file or a folder", param, ctx)
        return super().convert(expanded(value), param, ctx)


class UserText(click.types.StringParamType):
    """The type of words that may begin with a path, such as `~/mine.py:Planner`, a level's file or RUN:PLANNER."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return expanded_text(super().convert(value, param, ctx))


PATH = UserPath()
FILE = UserPath(dir_okay=False)
FOLDER = UserPath(file_okay=False)
TEXT = UserText()
POSITIVE = click.IntRange(min=1)
PLANNER = "NAME|pkg.module:Class|file.py:Class"


def completed(names: Callable[[], Iterable[str]]) -> Completion:
    """Completion by the shell: of a word, or of the last one of words between commas."""

    def complete(_context: click.Context, _parameter: click.Parameter, typed: str) -> list[str]:
        before, comma, last = typed.rpartition(",")
        return [f"{before}{comma}{name}" for name in names() if name.startswith(last)]

    return complete


def completed_of(names: Callable[[DataSet], Iterable[str]]) -> Completion:
    """The same of what a data set has: the one that the line names so far."""
    return lambda context, parameter, typed: completed(lambda: names(context.params.get("data") or DataSet.driven()))(
        context, parameter, typed
    )


registered_names = completed(registered)
scenario_ids = completed_of(lambda data: (row.scenario_id for row in rows_of(data, None)))


def _words(context: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> tuple[str, ...]:
    """What stands between commas, such as type ids and groups."""
    words = tuple(word.strip() for word in ",".join(texts).split(",") if word.strip())
    if texts and not words:
        raise click.BadParameter("names no type; leave it out for all", context, parameter)
    return words


def _country(_context: click.Context, _parameter: click.Parameter, code: str | None) -> Country | None:
    return None if code is None else load_country(code)


def _of_one_city(_context: click.Context, _parameter: click.Parameter, runs: tuple[Path, ...]) -> tuple[Path, ...]:
    cities = {city_of(manifest) for manifest in map(read_manifest, runs) if manifest is not None}
    if len(cities) > 1:
        raise InputError(f"the runs are of several cities: {', '.join(sorted(cities))}; take those of one")
    return runs


def words(name: str, help: str) -> Option:
    shown = completed_of(lambda data: types_and_groups(data.catalog))
    return click.option(name, multiple=True, metavar="TYPE,GROUP,…", callback=_words, help=help, shell_complete=shown)


def country(help: str) -> Option:
    return click.option("--country", metavar="CODE", callback=_country, help=help)


def planners(help: str, *, required: bool = False, default: tuple[str, ...] = ()) -> Option:
    several_times = f"{help}; give it several times for several planners."
    names, shown = ("--planner", "planners"), bool(default)
    given: dict[str, Any] = {"required": required, "default": default, "show_default": shown}
    given["shell_complete"] = registered_names
    return click.option(*names, multiple=True, type=TEXT, metavar=PLANNER, help=several_times, **given)


def split(default: str | None = None, *, required: bool = False, made: bool = False) -> Option:
    """`--split` and `--city`. made: the command makes something of the split."""
    # A default of None would be a value to click, and nothing that is missing.
    given: dict[str, Any] = {} if required else {"default": default}
    given["show_default"] = not required and (default or "all that are there")
    table = click.option("--split", type=click.Choice(SPLITS), required=required, help="Scenario table.", **given)
    return several(table, made_city if made else city)


def out(help: str, default: str | None = None, *, type: click.Path = PATH, required: bool = False) -> Option:
    metavar = "DIR" if type is FOLDER else "FILE" if type is FILE else "PATH"
    return click.option(
        "--out", type=type, required=required, default=default, show_default=True, metavar=metavar, help=help
    )


def png(help: str) -> Option:
    return click.option("--png", type=FILE, metavar="FILE", help=help)


def count(*names: str, default: int, help: str, least: int = 1, most: int | None = None) -> Option:
    kind = click.IntRange(least, most)
    return click.option(*names, type=kind, default=default, show_default=True, metavar="N", help=help)


def choice(name: str, values: Sequence[str], default: str, help: str | None = None) -> Option:
    return click.option(name, type=click.Choice(values), default=default, show_default=True, help=help)


def perception(help: str) -> Option:
    levels = "exact|good|production|poor|FILE"
    return click.option("--perception", type=TEXT, default=EXACT, show_default=True, metavar=levels, help=help)


def limit(help: str) -> Option:
    return click.option("--limit", type=POSITIVE, metavar="N", help=help)


def _of_city(read: Callable[[str], DataSet], *names: str, kind: Any = click.option, **given: Any) -> Option:
    """What names a city; the command gets its data set as `data`."""
    given |= {"metavar": "NAME", "shell_complete": completed(city_names)}
    made: Option = kind(*names, "data", callback=lambda _context, _parameter, name: read(name), **given)
    return made


_told: dict[str, Any] = {"is_eager": True, "envvar": CITY, "default": OWN_CITY}
_told["help"] = f"Whose data set (tsbench city list); default: {CITY}, or {OWN_CITY}."
city = _of_city(DataSet.driven, "--city", **_told)
# For commands that make data, which are of the city as it is stored.
made_city = _of_city(DataSet.named, "--city", **_told)
city_name = _of_city(DataSet.named, kind=click.argument)


# What Overpass is asked for.
def _bbox(required: bool) -> Option:
    return click.option("--bbox", required=required, metavar="W,S,E,N", help="The box, in degrees.")


_date = click.option(
    "--date",
    type=click.DateTime(["%Y-%m-%d"]),
    callback=lambda _c, _p, day: day and f"{day:%Y-%m-%d}",
    metavar="YYYY-MM-DD",
    help="The roads as they were on a day.  [default: as they are]",
)
_server = click.option("--server", metavar="URL", help="Who answers for Overpass.  [default: overpass-api.de]")
more = words("--more", "Types and groups that are drawn three times as often.")
osm = click.option("--osm", "osm_dir", type=PATH, help="Folder of extracts.  [default: sumo_nets/sources]")
caption_country = country("Sign with this country's plates and codes, such as de; rules stay as they are.")
runs = click.argument("runs", nargs=-1, required=True, metavar="RUN…", type=PATH, callback=_of_one_city)
workers = click.option(
    "--workers", type=POSITIVE, default=own_cores, show_default="one per core", metavar="N", help="Processes."
)
trajectories = click.option(
    "--trajectories",
    type=PATH,
    metavar="FILE",
    help="The oracle's chosen drives. Default: scenarios/oracle.parquet of the data folder.",
)
seed = click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0))


def several(*options: Option) -> Option:
    """Options in the order in which --help lists them."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            function = option(function)
        return function

    return add


box = several(_bbox(True), _date, _server)
box_or_file = several(_bbox(False), _date, _server)


def of(owner: type[Any]) -> Option:
    """The options among the fields of a dataclass, in their order; parameters have the fields' names."""
    defaults = {f.name: f.default for f in fields(owner)}
    return several(
        *(_made(name, known, defaults[name]) for name, known in options_in(owner).items() if known.kind != "city")
    )


def one_of(owner: type[Any], name: str) -> Option:
    """One of these options, for a command that takes the same."""
    default = next(f.default for f in fields(owner) if f.name == name)
    return _made(name, options_in(owner)[name], default)


def _made(name: str, known: Known, default: Any) -> Option:
    """An option as click has it."""
    flag = f"--{name.replace('_', '-')}"
    given: dict[str, Any] = {"metavar": known.metavar, "default": default, "show_default": default is not None}
    match known.kind:
        case "planners":
            return planners(known.help, required=True)
        case "split":
            return split(required=True)
        case "types":
            return words(flag, known.help)
        case "count" | "number":
            given["show_default"] = known.shown or default is not None
            given["metavar"] = known.metavar or "N"
            given["default"] = None if default is None else int(default)
            if known.kind == "number":
                # As Python gives it: a run's journal is known by the text of its options.
                given["callback"] = lambda _c, _p, value: float(value)
            return click.option(flag, type=click.IntRange(known.least), help=known.help, **given)
        case "choice":
            return choice(flag, known.choices, default, known.help)
        case "flag":
            return click.option(flag, is_flag=True, help=known.help)
        case "folder":
            return out(known.help, type=FOLDER)
        case "listeners":
            return click.option("--listener", name, type=TEXT, multiple=True, metavar=PLANNER, help=known.help)
        case _:
            return click.option(flag, type=TEXT, help=known.help, **given)


image = one_of(RunOptions, "image")
types = one_of(RunOptions, "types")
device = one_of(RunOptions, "device")
allow_partial = one_of(RunOptions, "allow_partial")
# Without a number the run itself decides: planners with networks want more episodes at once than there are cores.
run_workers = one_of(RunOptions, "workers")


def types_of(data: DataSet, words: tuple[str, ...], option: str = "--types") -> tuple[str, ...]:
    """The types that some types and groups are, sorted; none where none is named. Raises InputError."""
    return tuple(sorted(choose_types(data.catalog, words, option))) if words else ()


def rows_of(data: DataSet, split: str | None, words: tuple[str, ...] = ()) -> list[ScenarioSpec]:
    """The rows of some types and groups, by default of all.

    split: it must be there; None: of those splits that are, for only test need be.
    """
    there = data.splits if split is None else (split,)
    chosen = types_of(data, words)
    rows = (row for name in there or SPLITS[:1] for row in data.table(name))
    return [row for row in rows if not chosen or row.pair_type in chosen]
