"""Judge a run again from its traces: verdicts, figures and aggregates must come out as they stand in it.

`replay` checks that poses follow from commands. A planner runs in the process of the loop and may change it; motion
that its commands cannot have caused shows here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors
from tsbench.episode.outcome import EpisodeFacts, Outcome, TerminationCheck
from tsbench.episode.trace import Trace, read_trace, trace_path
from tsbench.metrics.aggregate import summarise
from tsbench.rules.monitors import make_monitors
from tsbench.run.edition import contract_now, standing_contract
from tsbench.run.log.folder import SUMMARY
from tsbench.run.log.journal import Key, read_table
from tsbench.run.log.manifest import Manifest, city_of, marks_of, planners_of, read_manifest
from tsbench.run.log.record import Row, same_value, score
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.sim.ego import Motion, advance, start_motion
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S, EgoState

# One tick from a recorded state is exact but for the last bits of sine and tangent, which are the C library's.
TOLERANCE = 1e-9
_MOTION = tuple(field.name for field in fields(Motion))


def replay(trace: Trace, scene: Scene, roads: Roads) -> Iterator[str]:
    """The first tick at which a trace is not where the command of the tick before leads, and how many there are."""
    lines = []
    wanted, last = start_motion(scene), scene.network.lane(scene.start.lane).index
    for tick, snapshot in enumerate(trace.snapshots):
        ego = snapshot.ego
        if snapshot.step != tick or abs(snapshot.time - tick * DT_S) > TOLERANCE:
            yield f"tick {tick} of its trace is numbered {snapshot.step}, {snapshot.time} s"
            return
        wrong = _motion(wanted, ego, tick) or _place(ego, roads, last)
        if wrong:
            lines.append(f"tick {tick}: {wrong}")
        if tick + 1 == len(trace.snapshots):
            break
        if tick >= len(trace.commands):
            yield f"tick {tick + 1}: no command leads there"
            return
        motion = Motion(*(getattr(ego, name) for name in _MOTION))
        wanted, last = advance(motion, *trace.commands[tick].tolist()), ego.lane
    if lines:
        yield f"its poses do not follow from its commands at {len(lines)} of {tick + 1} ticks, first {lines[0]}"


def _motion(wanted: Motion, ego: EgoState, tick: int) -> str:
    """In what the ego's motion is another, "" if in nothing."""
    apart = math.hypot(ego.x - wanted.x, ego.y - wanted.y)
    # Written so that what is no number differs too.
    if not apart <= TOLERANCE:
        return f"{apart:.3g} m from {'where its command leads' if tick else 'the start of the scene'}"
    for name in _MOTION:
        is_, should = getattr(ego, name), getattr(wanted, name)
        if not abs(is_ - should) <= TOLERANCE:
            return f"{name} is {is_:.6g}, not {should:.6g}"
    return ""


def _place(ego: EgoState, roads: Roads, last: int) -> str:
    """In what the ego's place on the road is another than that of its pose, "" if in nothing."""
    lane, s, d, on_road = roads.locator.locate(ego.x, ego.y, ego.heading, last)
    if (lane, on_road) != (ego.lane, ego.on_road):
        return f"lane is {ego.lane} (on the road: {ego.on_road}), by its pose {lane} ({on_road})"
    if not math.hypot(ego.s - s, ego.d - d) <= TOLERANCE:
        return f"place on its lane is {ego.s:.6g}, {ego.d:.6g}, by its pose {s:.6g}, {d:.6g}"
    return ""


@dataclass(frozen=True)
class Rescore:
    """traces: judged again; untraced: episodes without a readable one; disagreements: one line each.

    data: what was driven. contract: of this tsbench for the run's split. note: what to know before reading them, "" if
    nothing.
    """

    data: DataSet
    contract: str
    traces: int
    untraced: int
    note: str
    disagreements: tuple[str, ...]


def rescore(folder: Path) -> Rescore:
    """Compare a run with what its traces say. Raises InputError for a folder or trace that cannot be read."""
    manifest = read_manifest(folder)
    if manifest is None:
        raise InputError(f"{folder}: no run folder (it has no run.json)")
    episodes = read_table(folder / "episodes.parquet")
    rows: dict[Key, Row] = {(row["planner"], row["scenario_id"]): row for row in episodes.to_pylist()}
    events: dict[Key, list[Row]] = {key: [] for key in rows}
    lines: list[str] = []
    for event in read_table(folder / "violations.parquet").to_pylist():
        key = (event["planner"], event["scenario_id"])
        if key in events:
            events[key].append(event)
        else:
            lines.append(f"{key[0]} {key[1]}: an event of an episode that is not in the table")
    split = manifest["effective"]["split"]
    data = DataSet.named(city_of(manifest))
    table, now = data.table(split), standing_contract(contract_now(data, split))
    known = {spec.scenario_id: spec for spec in table} if now == standing_contract(manifest["contract"]) else None
    judge = Judge(data)
    judged = 0
    for key, row in rows.items():
        path = trace_path(folder, *key)
        if not path.is_file():
            if _had_trace(row, events[key], manifest["effective"]["trace"]):
                lines.append(f"{key[0]} {key[1]}: its trace is gone")
            continue
        try:
            trace = read_trace(path)
        except InputError as problem:
            lines.append(f"{key[0]} {key[1]}: {problem}")
            continue
        judged += 1
        if known is not None and trace.spec != known.get(key[1]):
            lines.append(f"{key[0]} {key[1]}: its trace is of another scenario than the table's row")
        try:
            for line in judge.compare(trace, key, row, events[key]):
                lines.append(f"{key[0]} {key[1]}: {line}")
        except (ValueError, InputError) as problem:
            lines.append(f"{key[0]} {key[1]}: its trace cannot be judged: {problem}")
    expected = {trace_path(folder, *key) for key in rows}
    for path in sorted((folder / "traces").rglob("*.parquet")):
        if path not in expected and not path.name.startswith("."):
            lines.append(f"{path}: a trace without its episode")
    lines += _summary_lines(folder, manifest, episodes)
    return Rescore(data, now, judged, len(rows) - judged, _contract_note(manifest, now), tuple(lines))


def _had_trace(row: Row, events: list[Row], kept: str) -> bool:
    """Was a trace written with this record? Of an error that is not known: it may have had no tick."""
    if Outcome(row["outcome"]).is_error:
        return False
    return kept == "all" or (kept == "violations" and (bool(events) or not row["scd"]))


class Judge:
    """Monitors and metrics run on traces."""

    def __init__(self, data: DataSet) -> None:
        self._loader = SceneLoader(data)

    def compare(self, trace: Trace, key: Key, row: Row, events: list[Row]) -> Iterator[str]:
        """What differs between an episode's record and its trace judged again."""
        if (trace.planner, trace.spec.scenario_id) != key:
            yield f"its trace is that of {trace.planner} {trace.spec.scenario_id}"
            return
        scene, roads = self._loader.load(trace.spec)
        yield from replay(trace, scene, roads)
        if trace.outcome.value != row["outcome"]:
            yield f"outcome is {row['outcome']}, by its trace {trace.outcome.value}"
            return
        if trace.outcome.is_error:
            # An error outcome has no figures: there is nothing more to agree on.
            return
        facts = self._facts(trace, scene, roads)
        if (facts.outcome, facts.contact) != (trace.outcome, trace.contact):
            yield f"outcome is {trace.outcome} ({trace.contact}), judged again {facts.outcome} ({facts.contact})"
            return
        new_row, new_events = score(trace.spec, trace.planner, row["privileged"], facts)
        yield from (
            f"{name} is {row[name]!r}, by its trace {new_row[name]!r}"
            for name in row
            if not same_value(row[name], new_row[name])
        )
        if len(events) != len(new_events):
            yield f"{len(events)} events, by its trace {len(new_events)}"
            return
        for old, new in zip(sorted(events, key=lambda event: event["number"]), new_events, strict=True):
            for name in old:
                if not same_value(old[name], new[name]):
                    yield f"event {old['number']}: {name} is {old[name]!r}, by its trace {new[name]!r}"

    def record(self, trace: Trace, privileged: bool) -> tuple[Row, list[Row]]:
        """The row and the events that follow from a trace.

        Raises InputError where what it shows is not how things move, or does not end as it says.
        """
        scene, roads = self._loader.load(trace.spec)
        facts = self._facts(trace, scene, roads)
        problem = next(iter(replay(trace, scene, roads)), None)
        if problem is None and facts.outcome is not trace.outcome:
            problem = f"its outcome is {trace.outcome}, judged again {facts.outcome}"
        if problem is not None:
            raise InputError(f"{trace.planner} {trace.spec.scenario_id}: {problem}")
        return score(trace.spec, trace.planner, privileged, facts)

    def _facts(self, trace: Trace, scene: Scene, roads: Roads) -> EpisodeFacts:
        monitors = make_monitors(scene)
        ending = TerminationCheck(scene, monitors.targets)
        outcome, seen = None, []
        for snapshot in trace.snapshots:
            seen.append(snapshot)
            monitors.update(snapshot)
            outcome = ending.at(snapshot)
            if outcome is not None:
                break
        # A trace that ends for no reason of its own is that of an ego that has left the map.
        return replace(
            trace.facts(roads.view, scene),
            snapshots=seen,
            outcome=outcome or Outcome.OFF_ROAD,
            contact=ending.contact,
            verdicts=monitors.finish(),
        )


def _contract_note(manifest: Manifest, now: str) -> str:
    """Under another contract a disagreement is no wonder."""
    if now == standing_contract(manifest["contract"]):
        return ""
    return f"the run's contract is {manifest['contract'][:12]}, that of this tsbench {now[:12]}"


def _summary_lines(folder: Path, manifest: Manifest, episodes: pa.Table) -> Iterator[str]:
    """An interrupted run has no summary, one with holes has a partial one."""
    path = folder / SUMMARY
    asked = dict.fromkeys((p.name for p in planners_of(manifest)), manifest["effective"]["scenarios"])
    holes = len(episodes) < sum(asked.values())
    if not path.is_file():
        if not holes:
            yield f"{path}: missing, though no episode is"
        return
    now = summarise(
        episodes,
        contract_hash=standing_contract(manifest["contract"]),
        edition=str(manifest.get("edition", "")),
        asked=asked,
        marks=marks_of(manifest),
        allow_partial=holes,
    )
    with io_errors_as_input_errors(path):
        if path.read_bytes() != now.to_json().encode():
            yield f"{path}: differs from the aggregates of the {len(episodes)} records"
