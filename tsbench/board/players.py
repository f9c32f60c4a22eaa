"""Failures of submissions that can be watched: which ones, and what the page's player shows of them.

Traces lie in a folder beside a submission, named as it (`mine-dev.json`, `mine-dev.traces/`); it is a run's folder of
one planner's traces, or some files of it. A trace is shown where it has, judged again, the verdict of the submission.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from tsbench.board.board_rows import BoardRow
from tsbench.board.submission import Submission, SubmittedEpisode, episode_of
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.outcome import Outcome
from tsbench.episode.trace import read_trace, trace_path
from tsbench.report.page.episode_player import EpisodePacker
from tsbench.report.page.page_format import pack_table, page_column
from tsbench.report.page.report_page import Embedded
from tsbench.run.rescore import Judge
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import SIGNED, ScenarioSpec

_COLUMNS = (
    page_column("planner", "driven", filter="choice", minor=True),
    page_column("scenario_type", "type", filter="choice"),
    page_column("half", "half", filter="choice", minor=True),
    page_column("failure", "failure", filter="choice", title="the clause that was violated, or how the drive ended"),
    page_column("told", "what happened", minor=True, wide=True),
    page_column("scenario_id", "scenario", minor=True),
    page_column("playable", "player", "flag", hidden=True),
)


@dataclass(frozen=True)
class PagePlayers:
    """blobs: of the page, with the table that opens the players; none where there is no trace. count: of failures."""

    blobs: dict[str, bytes]
    count: int


def failure_of(episode: SubmittedEpisode) -> str:
    """The name of what failed in an episode that failed: the first of its clauses, or how it ended."""
    return episode.clauses[0] if episode.clauses else episode.outcome


def telling(episodes: Sequence[SubmittedEpisode], most: int) -> list[SubmittedEpisode]:
    """At most so many failures: of the most frequent ones first, each kind in its turn."""
    kinds: dict[str, list[SubmittedEpisode]] = {}
    for episode in episodes:
        if not episode.scd:
            kinds.setdefault(failure_of(episode), []).append(episode)
    queues = [kinds[name] for name in sorted(kinds, key=lambda name: (-len(kinds[name]), name))]
    turns = zip_longest(*queues)
    return [episode for turn in turns for episode in turn if episode is not None][:most]


def traces_beside(path: Path) -> Path:
    """The folder for the traces of a submission."""
    return path.with_suffix(".traces")


def copy_traces(run: Path, submission: Submission, path: Path, most: int) -> int:
    """Copy the traces of the most telling failures of a run beside its submission at `path`; how many there are.

    With each that of the other half of its pair, where the run has it. Raises InputError.
    """
    specs = {spec.scenario_id: spec for spec in DataSet.named(submission.city).table(submission.split)}
    beside = traces_beside(path)

    def trace(episode: SubmittedEpisode) -> Path:
        return trace_path(run, submission.planner.name, episode.scenario_id)

    with io_errors_as_input_errors(beside):
        beside.mkdir(parents=True, exist_ok=True)
        chosen = list(_chosen(submission, specs, most, trace))
        for episode in chosen:
            write_atomic(beside / trace(episode).name, trace(episode).read_bytes())
    return len(chosen)


def show_failures(rows: Sequence[BoardRow], labels: Sequence[str], most: int) -> PagePlayers:
    """The most telling failures of each submission that have a trace, with the other half of each pair that has one.

    labels: of the submissions. most: failures of each; halves beside them are not counted. Raises InputError for a
    trace that cannot be read, or is not of what was submitted.
    """
    table, packed = list[tuple[Any, ...]](), Embedded()
    for row, label in zip(rows, labels, strict=True):
        if not row.checked or not traces_beside(row.path).is_dir():
            continue
        _add(row, label, most, table, packed)
    if not packed.rows:
        return PagePlayers({}, 0)
    values = {column["name"]: rows for column, rows in zip(_COLUMNS, zip(*table, strict=True), strict=True)}
    return PagePlayers({"episodes": pack_table(_COLUMNS, values), **packed.blobs}, len(packed.rows))


def _add(row: BoardRow, label: str, most: int, table: list[tuple[Any, ...]], packed: Embedded) -> None:
    """table: rows of the table that opens the players."""
    s = row.submission
    data = DataSet.named(s.city)
    specs = {spec.scenario_id: spec for spec in data.table(s.split)}
    judge, packer, artwork = Judge(data), EpisodePacker(data), data.artwork()

    def trace_of(episode: SubmittedEpisode) -> Path:
        return traces_beside(row.path) / trace_path(Path(), s.planner.name, episode.scenario_id).name

    for episode in _chosen(s, specs, most, trace_of):
        path = trace_of(episode)
        trace = read_trace(path)
        if trace.spec != specs[episode.scenario_id]:
            raise InputError(f"{path}: is of another scenario than {episode.scenario_id}")
        record, events = judge.record(trace, s.planner.privileged)
        if (now := episode_of(record, events)).verdict != episode.verdict:
            raise InputError(f"{path}: its verdict is {now.verdict}, as submitted {episode.verdict}")
        told = next((str(event["sentence"]) for event in events if event["target"]), "")
        failure = "" if episode.scd else failure_of(episode)
        table.append((label, trace.spec.pair_type, trace.spec.half, failure, told, trace.spec.scenario_id, True))
        packed.take(len(table) - 1, packer.pack(path, (s.planner.name, episode.scenario_id)), artwork, sys.maxsize)


def _chosen(
    submission: Submission, specs: Mapping[str, ScenarioSpec], most: int, trace: Callable[[SubmittedEpisode], Path]
) -> Iterator[SubmittedEpisode]:
    """Failures that have a trace, each with the other half of its pair, signed halves first."""
    # Of an error outcome no record follows from the trace.
    there = [e for e in submission.episodes if not Outcome(e.outcome).is_error and trace(e).is_file()]
    pairs: dict[str, list[SubmittedEpisode]] = {}
    for episode in sorted(there, key=lambda e: specs[e.scenario_id].half != SIGNED):
        pairs.setdefault(specs[episode.scenario_id].pair_name, []).append(episode)
    for name in dict.fromkeys(specs[e.scenario_id].pair_name for e in telling(there, most)):
        yield from pairs[name]
