"""What a run and its workers tell each other: one message in each line, its kind and its fields as JSON.

Floats come back bit for bit, and nothing is pickled: what a planner writes there is refused and runs nothing.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from tsbench.core.typed import typed
from tsbench.episode.perception_level import Perception
from tsbench.run.execution.task_queue import Task
from tsbench.run.log.record import Record
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet

M = TypeVar("M")

RUNNER = "tsbench.episode.runner:EpisodeRunner"
# What isolates planners is no part of the bench: it is loaded by name.
ISOLATED = "tsbench.board.isolation.isolated_loading"


@dataclass(frozen=True)
class Setup:
    """What all workers of a run are told.

    planners: by `Task.planner`. device: where their networks run. out: the run folder, for traces. trace: none,
    violations, all. data, split, contract: what a worker on another machine must have too. runner: module:Class of
    what runs episodes, made with a `LoadedPlanner`, `perception`, `heartbeat`, `data` and `options`; recorder:
    module:function from its result to a record. loader: module:function from a `PlannerInfo` and `hidden` to a
    `LoadedPlanner`, "" = planners run in the worker; hidden: what they must not find.
    """

    planners: tuple[PlannerInfo, ...]
    perception: Perception
    device: str
    trace: str
    out: str
    data: DataSet
    split: str
    contract: str
    runner: str = RUNNER
    recorder: str = "tsbench.run.log.record:make_record"
    options: Mapping[str, Any] = field(default_factory=dict)
    loader: str = ""
    hidden: tuple[str, ...] = ()


@dataclass(frozen=True)
class Start:
    """The first thing that a worker is told. sys_path: the run's, on which its planners are."""

    sys_path: tuple[str, ...]


@dataclass(frozen=True)
class Probe:
    """The question what a planner is. device: where its network runs."""

    spec: str
    device: str = "cpu"


@dataclass(frozen=True)
class Ready:
    """A worker has come up as this process."""

    pid: int


@dataclass(frozen=True)
class Probed:
    """The facts of a planner, or in one line the reason why it has none."""

    planner: PlannerInfo | None
    problem: str = ""


@dataclass(frozen=True)
class Finished:
    """The record of a task, by its number."""

    task: int
    record: Record


@dataclass(frozen=True)
class FolderFailed:
    """The run folder takes nothing more: an OSError, for the whole run to stop."""

    errno: int
    reason: str
    filename: str


@dataclass(frozen=True)
class Refused:
    """Why a machine takes no part, or what ends the run there."""

    problem: str


TO_WORKER = (Start, Setup, Probe, Task)
TO_RUN = (Ready, Probed, Finished, FolderFailed)


def encode(message: Any) -> bytes:
    return json.dumps([type(message).__name__, asdict(message)]).encode() + b"\n"


def decode(line: bytes | str, kinds: tuple[type[M], ...]) -> M:
    """The message of a line, one of these kinds. Raises ValueError or RecursionError for foreign ones."""
    told = json.loads(line)
    if not isinstance(told, list) or len(told) != 2:
        raise ValueError("no message of a worker")
    for kind in kinds:
        if kind.__name__ == told[0]:
            return typed(kind, told[1])
    raise ValueError(f"no message of a worker: {told[0]!r:.80}")
