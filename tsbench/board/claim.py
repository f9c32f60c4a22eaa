"""What can be driven again: a submission, or the records of a planner in a run folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.board.submission import (
    Figure,
    SubmittedEpisode,
    episode_of,
    fault_of_arithmetic,
    fault_of_episodes,
    fault_of_level,
    fault_of_lines,
    fault_of_place,
    fault_of_planner,
    read_submission,
)
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.episode.perception_level import Perception
from tsbench.run.log.manifest import city_of, planners_of
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.planner_info import PlannerInfo


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
    return Claim(
        path=path,
        sha256=s.sha256,
        title=s.title,
        tsbench=s.tsbench,
        edition=s.edition,
        contract=s.contract,
        city=s.city,
        split=s.split,
        planner=s.planner,
        device=s.device,
        arithmetic=s.arithmetic,
        perception=Perception(level=s.perception),
        figures=s.figures,
        episodes=s.episodes,
    )


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
