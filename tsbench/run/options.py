"""Options as fields of a dataclass, and those of a run.

A field that `option` declares is an option of the command line (`cli.options.of`), a keyword in Python
(`from_python`), and a key of tsbench.toml and of campaigns. `RunOptions` also says what stands in `run.json` and what
the workers are told. Checks of what is given from Python speak in a script's words.
"""

from __future__ import annotations

import math
import operator
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY, expanded, expanded_text
from tsbench.episode.perception_level import EXACT, Perception, load_level
from tsbench.planners.base import DEVICES
from tsbench.run.execution.local import EXECUTORS
from tsbench.run.execution.messages import RUNNER, Limits
from tsbench.run.listener import KNOWN, Listener
from tsbench.run.log.manifest import plain_perception
from tsbench.scenarios.data_set import SPLITS
from tsbench.scenarios.spec import HALVES

TOML = Path("tsbench.toml")
Kind = Literal["planners", "split", "city", "types", "count", "number", "choice", "flag", "text", "folder", "listeners"]


@dataclass(frozen=True, slots=True)
class Option:
    """What is known of an option beside its name and default.

    help: a sentence for `--help`.
    kind: how it is given and read.
    choices: the values that there are, () = any.
    least: of a number.
    metavar: what stands for the value in `--help`.
    shown: what stands for a default of None there.
    asked: does it stand in `run.json` as it was given?
    decides: does it decide what is in the folder, so that a run with another value is another run?
    """

    help: str
    kind: Kind
    choices: tuple[str, ...] = ()
    least: int = 1
    metavar: str | None = None
    shown: str | None = None
    asked: bool = True
    decides: bool = False


def option(kind: Kind, help: str, default: Any = MISSING, **known: Any) -> Any:
    """A field of a dataclass that is an option. known: as in `Option`."""
    return field(default=default, metadata={"option": Option(help, kind, **known)})


def options_in(owner: Any) -> dict[str, Option]:
    """The options among the fields of a dataclass, by name."""
    return {f.name: f.metadata["option"] for f in fields(owner) if "option" in f.metadata}


def from_python(owner: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of options by name, as a dataclass takes them. Raises InputError for a value of another kind."""
    known = options_in(owner)
    may_lack = {f.name for f in fields(owner) if f.default is None or f.default is MISSING} | {"city"}
    return {
        name: None if value is None and name in may_lack else _value(name, known[name], value)
        for name, value in given.items()
    }


def _value(name: str, known: Option, value: Any) -> Any:
    match known.kind:
        case "types":
            return type_words(name, value)
        case "count":
            return whole_number(name, value)
        case "number":
            return number_of(name, value, known.least)
        case "flag":
            return switch(name, value)
        case "folder":
            return path_of(name, value)
        case "text" if isinstance(value, Path):
            return expanded_text(str(value))
        case "text" | "city":
            return expanded_text(text(name, value))
        case _:
            if known.choices and value not in known.choices:
                raise InputError(f"{name} {value}: expected {', '.join(known.choices)}")
            return value


def toml_section(path: Path, name: str) -> Any:
    """A section of a TOML file, {} where it is missing. Raises InputError for what is no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8")).get(name, {})
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not TOML ({error})") from None


def whole_number(name: str, value: object, unit: str = "") -> int:
    """The value as an int. Raises InputError for a fraction, a truth value, words, and what is less than 1."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None:
        raise InputError(f"{name} {value!r}: expected a whole number")
    if number < 1:
        raise InputError(f"{name} {number}: expected at least 1{unit}")
    return number


def number_of(name: str, value: object, least: float) -> float:
    """The value as a float. Raises InputError for anything but a number, and below `least`."""
    try:
        number = math.nan if isinstance(value, str | bool) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} {value!r}: expected a number")
    if number < least:
        raise InputError(f"{name} {number:g}: expected at least {least:g}")
    return number


def switch(name: str, value: object) -> bool:
    """The value, True or False. Raises InputError for anything else: "no" would count as yes."""
    if not isinstance(value, bool):
        raise InputError(f"{name} {value!r}: expected True or False")
    return value


def text(name: str, value: object) -> str:
    """The value. Raises InputError for what is no text."""
    if not isinstance(value, str):
        raise InputError(f"{name} {value!r}: expected text")
    return value


def path_of(name: str, value: object) -> Path:
    """The value as a path, `~` at its beginning as the home folder. Raises InputError for other values."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f"{name} {value!r}: expected a path")
    if not os.fspath(value):
        raise InputError(f"{name}: is empty: name a file or a folder")
    return expanded(os.fspath(value))


def type_words(name: str, asked: str | Sequence[str] | None) -> tuple[str, ...]:
    """Types and groups, given one by one or with commas between them; none for None, which stands for the default.

    Raises InputError where no word is named: who filters a list down to nothing does not want all.
    """
    if asked is None:
        return ()
    given = asked.split(",") if isinstance(asked, str) else asked
    if not isinstance(given, list | tuple | set | frozenset) or not all(isinstance(w, str) for w in given):
        raise InputError(f"{name} {asked!r}: expected types and groups, as a text or a list of texts")
    words = tuple(word.strip() for word in given if word.strip())
    if not words:
        raise InputError(f"{name} {asked!r}: names no type; leave it out where none is to be named")
    return words


# With what the drawn ones are drawn of each of.
DRAWN = {"one-per-map": ("pair_type", "map_id"), "one-per-type": ("pair_type",)}
VARIANTS = ("0", "all", *DRAWN)
BOTH = "both"
WHICH_HALVES = (BOTH, *HALVES)
TRACES = ("none", "violations", "all")
# Of what is said of options; a command stays as it is.
_OPTION = re.compile(r"tsbench [^:;,()]*|--([a-z][a-z-]*)")
# Left out of `effective` where they have their default: they are younger than the first runs.
_QUIET = ("city", "isolate")


@dataclass(frozen=True)
class RunOptions:
    """Everything that `tsbench run` takes; a new option is one field. The first six choose episodes.

    planners: specs in the order given. types: ids and group names of types of pairs (a row without a pair counts as
    one), empty = all. limit: scenarios for each planner, None = all. out: None = a name below `runs/`.
    limits: of workers, beside `memory_limit`; for tests, as `runner`, what runs an episode in a worker.
    """

    planners: tuple[str, ...] = option("planners", "Planner to run")
    split: str = option("split", "Scenario table.", choices=SPLITS, decides=True)
    types: tuple[str, ...] = option("types", "Scenario types and groups; default: all.", (), decides=True)
    limit: int | None = option(
        "count",
        "Scenarios for each planner, no pair in part: types in turn, nominal ones first; of drawn ones any.",
        None,
        decides=True,
    )
    variants: str = option(
        "choice",
        "The nominal variant, all, or one drawn for each map, or type: a quick look.",
        "all",
        choices=VARIANTS,
        decides=True,
    )
    half: str = option(
        "choice",
        "Of contrast pairs: the signed half (with what has no pair), the contrast half, or both.",
        BOTH,
        choices=WHICH_HALVES,
        decides=True,
    )
    city: str = option("city", "", OWN_CITY, asked=False, decides=True)
    workers: int | None = option("count", "Cores to use.", None, shown="all")
    memory_limit: float = option(
        "number",
        "Most that a worker, with all that its planner has started, may take in an episode.",
        Limits.most_memory,
        least=512,
        metavar="MB",
        decides=True,
    )
    executor: str = option(
        "choice", "Where: on this machine, or on the Ray cluster that RAY_ADDRESS names.", "local", choices=EXECUTORS
    )
    out: Path | None = option(
        "folder", "Run folder; one with part of the same run is continued. Default: below runs/.", None
    )
    trace: str = option(
        "choice",
        "Episodes to keep tick by tick: none, those with a violation or without success, all.",
        "violations",
        choices=TRACES,
        decides=True,
    )
    device: str = option("choice", "For learned planners.", "cpu", choices=DEVICES, decides=True)
    isolate: bool = option(
        "flag", "Run planners in processes of their own, out of reach of data, run and referee.", False, decides=True
    )
    image: str | None = option(
        "text",
        "Run isolated planners in containers of this image, by Docker or Podman: docs/isolation.md.",
        None,
        metavar="IMAGE",
        asked=False,
    )
    mask_signs: bool = option("flag", "Remove sign identity from what planners see.", False)
    perception: str = option(
        "text",
        "How well planners perceive plates: a level, or a YAML file with the fields of one.",
        EXACT,
        metavar="exact|good|production|poor|FILE",
    )
    overwrite: bool = option(
        "flag", "Remove the run that is in the folder, and drive all of it again.", False, asked=False
    )
    allow_partial: bool = option("flag", "Take what has missing records too; the title says so.", False, asked=False)
    listeners: tuple[str | Listener, ...] = option(
        "listeners",
        f"Who is told how the run goes, such as a tracker: {', '.join(KNOWN)}, or one of your own.",
        (),
        asked=False,
    )
    limits: Limits = field(default_factory=Limits)
    runner: str = RUNNER

    def check(self) -> None:
        """Refuse options that do not go together. Raises InputError."""
        if self.isolate and (self.executor != "local" or self.device != "cpu"):
            raise InputError(
                "--isolate: planners are isolated on this machine and its CPU: leave out --executor and --device"
            )

    def perceived(self) -> Perception:
        """How plates reach the planners. Raises InputError for no level."""
        return Perception(self.mask_signs, load_level(self.perception))

    def folder_name(self, names: Sequence[str], contract: str) -> str:
        """Folder name of a run without `--out`; runs that differ in their selection do not meet in one folder."""
        shown = [*names[:3], *([f"and-{len(names) - 3}-more"] if len(names) > 3 else [])]
        parts = ["+".join(quote(name, safe="") for name in shown), self.split]
        parts += ["+".join(self.types)] if self.types else []
        parts += [f"variants-{self.variants}"] if self.variants != "all" else []
        parts += [f"{self.half}-half"] if self.half != BOTH else []
        parts += [f"limit-{self.limit}"] if self.limit is not None else []
        parts += ["masked"] if self.mask_signs else []
        parts += [] if self.perception == EXACT else [f"eyes-{quote(Path(self.perception).stem, safe='')}"]
        return "-".join([*parts, contract[:8]])

    def plain(self) -> dict[str, Any]:
        """What was asked, as it stands in a manifest."""
        asked = {name: getattr(self, name) for name, known in options_in(self).items() if known.asked}
        asked["out"] = None if self.out is None else str(self.out)
        if self.perception == EXACT:
            del asked["perception"]
        return asked

    def resolved(self, types: Sequence[str], scenarios: int, perception: Perception) -> dict[str, Any]:
        """What the options came to, as far as it decides what stands in the folder. types, scenarios: of the plan."""
        default = {f.name: f.default for f in fields(self)}
        values = {name: getattr(self, name) for name, known in options_in(self).items() if known.decides}
        told = {name: v for name, v in values.items() if name not in _QUIET or v != default[name]}
        told |= {"types": list(types), "scenarios": scenarios}
        return told | plain_perception(perception)


@contextmanager
def keywords() -> Iterator[None]:
    """Within it, or within a function that it decorates, an InputError names keywords: `force=True` for `--force`."""
    try:
        yield
    except InputError as error:
        told = _OPTION.sub(_keyword, str(error))
        if type(error) is not InputError or told == str(error):
            raise
        raise InputError(told) from error.__cause__


def _keyword(found: re.Match[str]) -> str:
    if found[1] is None:
        return found[0]
    name = found[1].replace("-", "_")
    known = options_in(RunOptions).get(name)
    return f"{name}=True" if name == "force" or (known and known.kind == "flag") else name
