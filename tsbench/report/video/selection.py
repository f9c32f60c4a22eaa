"""Which episodes of a run a command means: one by its name, or many by what their records say."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import trace_path
from tsbench.run.log.read import read_run
from tsbench.run.plan import choose_types
from tsbench.signs.catalog import load_catalog

_COLUMNS = ("planner", "scenario_id", "scenario_type", "outcome", "violations")


@dataclass(frozen=True, slots=True)
class Selection:
    """All that is given must hold; nothing given selects nothing.

    violations: the target sign was violated. types: type ids and groups. planners: names in the records.
    outcomes: how the episode ended.
    """

    violations: bool = False
    types: tuple[str, ...] = ()
    planners: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.violations or self.types or self.planners or self.outcomes)


@dataclass(frozen=True, slots=True)
class Chosen:
    """Traces of the selected episodes, sorted by planner and scenario; untraced: how many have none."""

    traces: tuple[Path, ...]
    untraced: int


def select_traces(run: Path, selection: Selection) -> Chosen:
    """The traces of a selection. Raises InputError: no run, unknown names, nothing selected, no trace of it."""
    stored = read_run(run)
    _check_names("--planner", selection.planners, stored.asked)
    _check_names("--outcome", selection.outcomes, map(str, Outcome))
    types = set(choose_types(selection.types, load_catalog()))
    rows = stored.episodes.select(_COLUMNS).to_pylist()
    chosen = [
        (row["planner"], row["scenario_id"])
        for row in rows
        if row["scenario_type"] in types
        and (not selection.violations or row["violations"])
        and (not selection.planners or row["planner"] in selection.planners)
        and (not selection.outcomes or row["outcome"] in selection.outcomes)
    ]
    if not chosen:
        raise InputError(f"{run}: none of its {len(rows)} episodes is selected")
    paths = [trace_path(run, *key) for key in sorted(chosen)]
    there = tuple(path for path in paths if path.is_file())
    if not there:
        raise InputError(
            f"{run}: none of the {len(paths)} selected episodes has a trace (tsbench run --trace all keeps them)"
        )
    return Chosen(there, len(paths) - len(there))


def episode_name(trace: Path) -> str:
    """PLANNER/SCENARIO of a trace, as commands take it."""
    return f"{unquote(trace.parent.name)}/{unquote(trace.stem)}"


def _check_names(option: str, asked: Iterable[str], known: Iterable[str]) -> None:
    names = list(known)
    for name in asked:
        if name not in names:
            raise InputError(f"{option} {name}: there are {', '.join(names)}")
