"""From a run to a submission, and what can be driven again: a submission, or a planner's records in a run folder.

A submission is made after all checks that need no second drive.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tsbench.board.submission import (
    Figure,
    Submission,
    SubmittedEpisode,
    episode_of,
    fault_of_arithmetic,
    fault_of_episodes,
    fault_of_level,
    fault_of_lines,
    fault_of_place,
    fault_of_planner,
    fault_of_words,
    figures_of,
    read_submission,
)
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.episode.perception_level import EXACTLY, Perception, PerceptionLevel
from tsbench.episode.trace import trace_path
from tsbench.run.edition import LOCAL
from tsbench.run.log.manifest import city_of, plain_perception, planners_of
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.options import BOTH
from tsbench.run.planner_info import PlannerInfo
from tsbench.run.rescore import rescore

# What a row of the leaderboard is of: everything, as the planner is.
_WHOLE = {"variants": "all", "half": BOTH, "limit": None, **plain_perception(EXACTLY)}
_SHOWN = 3


def make_submission(
    folder: Path,
    planner: str | None,
    *,
    title: str,
    authors: str,
    url: str,
    note: str,
    third_party: bool,
    shared_process: bool = False,
) -> Submission:
    """The submission of a planner's run. planner: its name in the records, None where the run has one only.
    shared_process: take a run whose planner shared the referee's process, which the row then says.

    Raises InputError: the run is not complete or not of a whole split, was changed, was not isolated, is of no released
    contract, or does not agree with its traces.
    """
    if fault := fault_of_words({"title": title, "authors": authors, "url": url, "note": note}):
        raise InputError(f"--{fault}")
    run = read_run(folder)
    info = _planner(run, planner)
    _check(run, info)
    if not shared_process and run.manifest.get("isolation", {}).get(info.name) is None:
        raise InputError(
            f"{folder}: {info.name} shared the referee's process: drive it with --isolate (or submit it with "
            "--shared-process: its row says so)"
        )
    split = str(run.manifest["effective"]["split"])
    table = run.data.table(split)
    judged = rescore(folder)
    if judged.contract != run.contract:
        raise InputError(f"{folder}: {judged.note}: submit with the tsbench and the data that drove it")
    if judged.disagreements:
        shown = "; ".join(judged.disagreements[:_SHOWN])
        raise InputError(f"{folder}: {len(judged.disagreements)} disagreements with its own traces: {shown}")
    episodes = episodes_of(run, info, events_of(run))
    m = run.manifest
    return Submission(
        title=title or info.name, authors=authors, url=url, note=note, third_party=third_party,
        tsbench=str(m["versions"]["tsbench"]), edition=run.edition, contract=run.contract, city=city_of(m),
        split=split, planner=info, device=str(m["effective"]["device"]), finished=str(m["finished"]),
        arithmetic=m["arithmetic"], versions=m["versions"], machine=m["machine"], git=m["git"],
        rescored=sum(trace_path(folder, info.name, one.scenario_id).is_file() for one in episodes),
        isolation=m.get("isolation", {}).get(info.name), perception=_level(run),
        figures=figures_of(episodes, table, info, run.contract), episodes=episodes,
    )  # fmt: skip


def _level(run: StoredRun) -> PerceptionLevel | None:
    """How plates reached its planners. Raises InputError for a level under the name of one of tsbench's."""
    level = run.perception.level
    if fault := fault_of_level(level):
        raise InputError(f"{run.path}: {fault}: drive it with a file of another name")
    return level


def _planner(run: StoredRun, name: str | None) -> PlannerInfo:
    found = [info for info in planners_of(run.manifest) if name in (None, info.name)]
    names = ", ".join(info.name for info in planners_of(run.manifest))
    if name is None and len(found) > 1:
        raise InputError(f"{run.path}: several planners: name one with --planner ({names})")
    if not found:
        raise InputError(f"{run.path}: no planner {name}; there are {names}")
    return found[0]


def _check(run: StoredRun, info: PlannerInfo) -> None:
    """Is it a run that a row may be made of? Raises InputError with what to do."""
    effective, status = run.manifest["effective"], run.manifest["status"]
    if fault := fault_of_planner(info):
        raise InputError(f"{run.path}: {fault}: rename it and drive it again")
    if status != "complete" or run.holes(info.name):
        raise InputError(f"{run.path}: {run.holes(info.name)} episodes are missing: the same command continues it")
    for key, wanted in _WHOLE.items():
        if effective.get(key) != wanted:
            raise InputError(f"{run.path}: {key} is {effective.get(key)}: a submission is of a whole split")
    if run.edition.endswith(LOCAL):
        raise InputError(
            f"{run.path}: edition {run.edition}: code or data were changed since the release: drive it with what was "
            "released"
        )


@dataclass(frozen=True)
class Claim:
    """What some file says of one planner's episodes, and how they were driven.

    sha256: of what a submission says, or of a run's file. figures: None where the file has none. episodes: sorted by
    scenario_id.
    """

    path: Path
    sha256: str
    title: str
    tsbench: str
    edition: str
    contract: str
    city: str
    split: str
    planner: PlannerInfo
    device: str
    arithmetic: dict[str, Any]
    perception: Perception
    figures: tuple[Figure, ...] | None
    episodes: tuple[SubmittedEpisode, ...]


def claim_of(path: Path) -> Claim:
    """What a submission says. Raises InputError as `read_submission` does."""
    s = read_submission(path)
    same = {field.name: getattr(s, field.name) for field in fields(Claim) if field.name not in ("path", "perception")}
    return Claim(path=path, perception=Perception(level=s.perception), **same)


def claims_of(folder: Path) -> list[Claim]:
    """What a run says of each of its planners, in its order, as far as it has got.

    Raises InputError for no run, and for what a submission may not say either.
    """
    run = read_run(folder)
    path = folder / "episodes.parquet"
    told = events_of(run)
    m, effective = run.manifest, run.manifest["effective"]
    versions: dict[str, Any] = m.get("versions", {})
    planners, device = planners_of(m), str(effective.get("device", "cpu"))
    fault = (
        fault_of_place(city_of(m), str(effective["split"]), device)
        or fault_of_level(run.perception.level)
        or fault_of_arithmetic(m.get("arithmetic"))
        or fault_of_lines([m["arithmetic"], m["planners"], versions, run.edition, run.contract])
        or next(filter(None, map(fault_of_planner, planners)), "")
    )
    if fault:
        raise InputError(f"{folder}: {fault}")
    return [
        Claim(
            path=path, sha256=sha256_of(path), title=info.name, tsbench=str(versions.get("tsbench", "?")),
            edition=run.edition, contract=run.contract, city=city_of(m), split=str(effective["split"]), planner=info,
            device=device, arithmetic=m["arithmetic"], perception=run.perception, figures=None,
            episodes=episodes_of(run, info, told),
        )
        for info in planners
    ]  # fmt: skip


Events = Mapping[tuple[str, str], list[dict[str, object]]]


def events_of(run: StoredRun) -> Events:
    """The violations of a run, by planner and scenario_id."""
    events: dict[tuple[str, str], list[dict[str, object]]] = {}
    for event in run.violations.to_pylist():
        events.setdefault((event["planner"], event["scenario_id"]), []).append(event)
    return events


def episodes_of(run: StoredRun, info: PlannerInfo, events: Events) -> tuple[SubmittedEpisode, ...]:
    """A planner's episodes in a run, with their digests, sorted by scenario_id.

    Raises InputError for a run without them, and for what no run writes.
    """
    rows = sorted(run.of(info.name).to_pylist(), key=lambda row: row["scenario_id"])
    if not rows:
        raise InputError(f"{run.path}: no episode of {info.name} yet")
    made = tuple(episode_of(row, events.get((info.name, row["scenario_id"]), ())) for row in rows)
    if fault := fault_of_episodes(made):
        raise InputError(f"{run.path}: {info.name}: {fault}")
    return made
