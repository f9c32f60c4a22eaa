"""Listeners of a run beside its console, such as a tracker of experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from tsbench.core.errors import InputError, load
from tsbench.planners.planner_spec import import_attribute
from tsbench.run.log.record import Row

if TYPE_CHECKING:
    from tsbench.run.session import RunResult

# By the name that `--listener` takes.
KNOWN = {"tensorboard": "tsbench.run.tensorboard:TensorBoard"}


@dataclass(frozen=True)
class Started:
    """A run that begins or goes on. asked: episodes by planner; options: all that were given, as in `run.json`."""

    folder: Path
    contract: str
    edition: str
    asked: Mapping[str, int]
    options: Mapping[str, Any]


class Listener(Protocol):
    """What it raises ends the run; finished episodes are kept, and the same call goes on."""

    def started(self, run: Started) -> None:
        """The run begins, or goes on."""

    def episode(self, row: Row) -> None:
        """An episode of this session is finished; row: its columns of `episodes.parquet`."""

    def finished(self, result: RunResult) -> None:
        """The run has ended; its folder holds all that there is."""


_CALLS = ("started", "episode", "finished")


def listeners_of(listeners: object) -> list[Listener]:
    """Listeners, each an object or what `--listener` takes. Raises InputError for what is no list of these."""
    if not isinstance(listeners, list | tuple):
        raise InputError(f"listeners {listeners!r}: expected a list of listeners")
    made = [make_listener(one) if isinstance(one, str) else one for one in listeners]
    for one in made:
        if isinstance(one, type) or not all(callable(getattr(one, name, None)) for name in _CALLS):
            raise InputError(f"listeners: {one!r}: expected an object with {', '.join(_CALLS)}")
    return made


def make_listener(spec: str) -> Listener:
    """A listener by its name, pkg.module:Class or file.py:Class, made without arguments. Raises InputError."""
    where = f"--listener {spec}"
    if spec not in KNOWN and ":" not in spec:
        raise InputError(f"{where}: expected {', '.join(KNOWN)}, pkg.module:Class or file.py:Class")
    source, _, attribute = KNOWN.get(spec, spec).rpartition(":")
    made = load(source).__dict__[attribute] if spec in KNOWN else import_attribute(source, attribute, where)
    missing = [name for name in _CALLS if not callable(getattr(made, name, None))]
    if not isinstance(made, type) or missing:
        raise InputError(f"{where}: expected a class with started, episode and finished")
    return cast(Listener, made())
