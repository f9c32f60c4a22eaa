"""`tsbench oracle select`: of each scenario the best two drives that obeyed and arrived.

Source: docs/oracle.md, "select". Of the experts without a network (the IDM kind) only the fastest counts; drives
are ranked by the F-score of speed and comfort, Q = (1 + b^2) v s / (b^2 v + s) with b = 0.25. Beside the table of
drives stand that of all tries and what they were made with. `stats` says what a table holds, `verify` whether it
replays.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tsbench.core.errors import InputError
from tsbench.core.seeds import seed_of
from tsbench.learn.imitation.recipe import kept_for_validation
from tsbench.learn.oracle.store import (
    KIND,
    RULES,
    basis,
    copy_beside,
    fingerprint,
    read_collection,
    read_drives,
    read_tries,
)
from tsbench.learn.oracle.trajectories import Recorded, Replayer, stream_trajectories, write_trajectories
from tsbench.run.log.record import Row
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

if TYPE_CHECKING:
    from tsbench.report.analyses.analysis import Analysis


BETA = 0.25
KEPT = 2
TRAIN, VALIDATION = "train", "validation"


@dataclass(frozen=True, slots=True)
class Candidate:
    """A successful drive. rules: its expert has no network; steps: ticks; comfort: share of steps; row: its try."""

    planner: str
    rules: bool
    steps: int
    comfort: float
    row: Row


@dataclass(frozen=True)
class Selected:
    """What was chosen. scenarios: that were driven; covered: that have a drive; drives, validation: how many;
    others: that count and are not among the best; uncovered: scenarios without one, by type.
    """

    path: Path
    scenarios: int
    covered: int
    drives: int
    validation: int
    others: int
    uncovered: Mapping[str, int]


def f_score(speed: float, comfort: float) -> float:
    """Q of two shares in [0, 1]: b below 1 weighs `speed` above `comfort`."""
    weight = BETA * BETA
    below = weight * speed + comfort
    return (1.0 + weight) * speed * comfort / below if below > 0.0 else 0.0


def rank(candidates: Sequence[Candidate]) -> list[tuple[Candidate, float]]:
    """The drives of one scenario that count, with their Q, best first; ties by fewer steps, then by name."""
    rules = [c for c in candidates if c.rules]
    running = [c for c in candidates if not c.rules]
    running += sorted(rules, key=lambda c: (c.steps, -c.comfort, c.planner))[:1]
    fastest = min((c.steps for c in running), default=0)
    scored = [(c, f_score(fastest / c.steps, c.comfort)) for c in running]
    return sorted(scored, key=lambda pair: (-pair[1], pair[0].steps, pair[0].planner))


def part_of(spec: ScenarioSpec) -> str:
    """TRAIN or VALIDATION, by map: a fifth of the maps, among them all that base planners are validated on."""
    # 1/12 + 11/12 * 7/55 = 1/5.
    kept = kept_for_validation(spec) or seed_of(KIND, VALIDATION, spec.map_id) % 55 < 7
    return VALIDATION if kept else TRAIN


def select(data: DataSet, folder: Path, path: Path, allow_partial: bool) -> Selected:
    """Choose from a collection and write the table `path`, and beside it all tries and what they were made with.

    Raises InputError: no collection, one that is not finished (unless `allow_partial`), or of other code or scenarios.
    """
    manifest = read_collection(folder)
    if manifest["status"] != "complete" and not allow_partial:
        raise InputError(f"{folder}: its collection is not finished: run it again, or give --allow-partial")
    if manifest["contract"] != basis(data):
        raise InputError(f"{folder}: was collected with other rules or another SUMO: collect anew into another folder")
    rows = {row.scenario_id: row for row in data.table(manifest["effective"]["split"])}
    tries = read_tries(folder)
    for one in tries:
        spec = rows.get(one["scenario_id"])
        if spec is None or fingerprint(spec) != one["scenario"]:
            raise InputError(
                f"{folder}: scenario {one['scenario_id']} has changed since: tsbench oracle collect drives it again"
            )
    best = _best(tries)
    keys = {
        (c.planner, scenario): (c, q, k if k <= KEPT else 0)
        for scenario, b in best.items()
        for k, (c, q) in enumerate(b, start=1)
    }
    drives = []
    for key, commands, intents in read_drives(folder, set(keys)):
        candidate, quality, place = keys[key]
        drives.append(
            Recorded(
                scenario_id=key[1], planner=key[0], attempt=candidate.row["attempt"], part=part_of(rows[key[1]]),
                rank=place, quality=quality, comfort=candidate.comfort, commands=commands, intents=intents,
                ego=candidate.row["ego"], others=candidate.row["others"],
            )
        )  # fmt: skip
    if len(drives) != len(keys):
        raise InputError(f"{folder}: {len(keys) - len(drives)} drives of its table are not in its journal")
    write_trajectories(drives, path)
    copy_beside(folder, path)
    driven = {one["scenario_id"]: one["scenario_type"] for one in tries}
    uncovered = Counter(kind for scenario, kind in driven.items() if scenario not in best)
    ranked = [drive for drive in drives if drive.rank]
    validation, others = sum(drive.part == VALIDATION for drive in ranked), len(drives) - len(ranked)
    return Selected(path, len(driven), len(best), len(ranked), validation, others, dict(sorted(uncovered.items())))


def _best(tries: Iterable[Row]) -> dict[str, list[tuple[Candidate, float]]]:
    """The drives of each scenario that count, best first, where there are any."""
    found: dict[str, list[Candidate]] = defaultdict(list)
    for row in tries:
        if row["scd"]:
            one = Candidate(row["planner"], row["kind"] == RULES, row["steps"], row["comfort"] or 0.0, row)
            found[row["scenario_id"]].append(one)
    return {scenario: rank(candidates) for scenario, candidates in sorted(found.items())}


def stats(data: DataSet, path: Path, split: str) -> Analysis:
    """The composition of a table. Raises InputError for drives of scenarios that the split does not have."""
    from tsbench.report.analyses.oracle_composition import RankedDrive, composition  # brings matplotlib

    rows = _rows(data, split)
    chosen = [
        RankedDrive(d.scenario_id, rows[d.scenario_id].group, d.planner, d.rank, d.part, len(d.commands) * DT_S)
        for d in _drives(path, data.table_path(split), rows)
        if d.rank
    ]
    return composition(chosen, Counter(row.group for row in rows.values()), split)


def verify(data: DataSet, path: Path, split: str, limit: int | None) -> int:
    """Replay drives of a table, `limit` of them drawn by hash; returns how many.

    Raises SimulationError, which says which and how, for one that comes out otherwise than it was recorded.
    """
    rows = _rows(data, split)
    names = ((d.scenario_id, d.planner) for d in _drives(path, data.table_path(split), rows))
    chosen = set(sorted(names, key=lambda name: seed_of(KIND, "verify", *name))[:limit])
    with closing(Simulation()) as simulation:
        replayer = Replayer(simulation, SceneLoader(data))
        # In the table's order, in which scenarios of a network follow each other.
        for drive in stream_trajectories(path):
            if (drive.scenario_id, drive.planner) in chosen:
                replayer.replay(drive, rows[drive.scenario_id])
    return len(chosen)


def _rows(data: DataSet, split: str) -> dict[str, ScenarioSpec]:
    return {row.scenario_id: row for row in data.table(split)}


def _drives(path: Path, table: Path, rows: Mapping[str, ScenarioSpec]) -> Iterator[Recorded]:
    """The drives of a table, one after the other. Raises InputError for one of a scenario that `rows` lack."""
    for drive in stream_trajectories(path):
        if drive.scenario_id not in rows:
            raise InputError(f"{path}: scenario {drive.scenario_id} is not in {table}")
        yield drive
