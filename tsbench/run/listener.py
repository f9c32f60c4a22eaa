"""Listeners of a run: the console, and others beside it, such as a tracker of experiments."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

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


_REFRESH_PER_S = 2.0
LINE_EVERY_S = 15.0
# Finished episodes over which the pace is taken.
_WINDOW_S = 30.0


class ProgressWatcher:
    """Follows a run on a console."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bars: dict[str, TaskID] = {}
        self._count: dict[str, int] = {}
        self._success: dict[str, int] = {}
        self._pairs: dict[str, list[bool]] = {}
        self._halves: dict[tuple[str, str], bool] = {}
        self._asked: dict[str, int] = {}
        self._total = 0
        self._began = self._said = time.monotonic()
        self._fresh = 0
        self._progress = Progress(
            TextColumn("{task.description}"), BarColumn(bar_width=None), MofNCompleteColumn(),
            TextColumn("{task.fields[scd]}"), TextColumn("{task.fields[pace]}"), TimeRemainingColumn(compact=True),
            console=console, refresh_per_second=_REFRESH_PER_S, disable=not console.is_terminal,
            speed_estimate_period=_WINDOW_S, expand=True,
        )  # fmt: skip

    def notice(self, line: str) -> None:
        self._print(f"note: {line}")

    def begin(self, asked: Mapping[str, int], done: Iterable[Row]) -> None:
        self._asked = dict(asked)
        self._total = sum(asked.values())
        self._count = dict.fromkeys(asked, 0)
        self._success = dict.fromkeys(asked, 0)
        self._pairs = {name: [] for name in asked}
        self._halves.clear()
        for row in done:
            self._take(row)
        there = sum(self._count.values())
        if there:
            self.notice(f"continuing: {there} of {self._total} episodes are already there")
        self._began = self._said = time.monotonic()
        for name, count in asked.items():
            self._bars[name] = self._progress.add_task(
                name, total=count, completed=self._count[name], start=False, scd=self._scd(name), pace=""
            )
        self._progress.start()

    def episode(self, row: Row) -> None:
        name = row["planner"]
        self._take(row)
        self._fresh += 1
        bar = self._bars[name]
        now = time.monotonic()
        if not self._console.is_terminal:
            self._say(now)
            return
        if now - self._said < 1 / _REFRESH_PER_S and self._count[name] < self._asked[name]:
            return
        self._said = now
        task = self._progress.tasks[bar]
        if not task.started:
            self._progress.start_task(bar)
        pace = f"{task.speed:.1f} ep/s" if task.speed else ""
        self._progress.update(bar, completed=self._count[name], scd=self._scd(name), pace=pace)

    def end(self) -> None:
        self._progress.stop()

    def _take(self, row: Row) -> None:
        name, passed = row["planner"], bool(row["scd"])
        self._count[name] += 1
        self._success[name] += passed
        # Rows of a collection have no pairs.
        if pair_id := row.get("pair_id"):
            pair = name, pair_id
            if pair in self._halves:
                self._pairs[name].append(self._halves.pop(pair) and passed)
            else:
                self._halves[pair] = passed

    def _scd(self, name: str) -> str:
        """Paired SCD so far; SCD of the episodes as long as no pair is whole, or where no pairs are driven."""
        if pairs := self._pairs[name]:
            return f"paired SCD {100 * sum(pairs) / len(pairs):5.1f} %"
        count = self._count[name]
        return f"SCD {100 * self._success[name] / count:5.1f} %" if count else "SCD     –  "

    def _say(self, now: float) -> None:
        if now - self._said < LINE_EVERY_S:
            return
        self._said = now
        done = sum(self._count.values())
        pace = self._fresh / (now - self._began)
        left = round((self._total - done) / pace)
        scd = ", ".join(f"{name} {' '.join(self._scd(name).split())}" for name in self._count if self._count[name])
        self._print(f"{done}/{self._total} episodes, {pace:.1f} ep/s, {left // 60}:{left % 60:02d} left, {scd}")

    def _print(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)
