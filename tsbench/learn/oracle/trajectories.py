"""Drives kept by their commands: a drive is simulated again from them, bit for bit, wherever its ticks are needed.

Commands are whole numbers of small steps (`STEPS`), and the drive itself is driven with the rounded ones
(`QuantisedPlanner`), so nothing is lost by storing them. The table keeps fingerprints of what was driven, which a
replay must meet. `OracleRunner` drives one expert on one scenario until it obeys and arrives.
Units: m/s2, rad.
"""

from __future__ import annotations

import zlib
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from tsbench.core.errors import PlannerOutputError, SimulationError
from tsbench.core.files import io_errors_as_input_errors
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, columns, open_table, save_table
from tsbench.core.paths import data_file
from tsbench.core.text import one_line
from tsbench.core.typed import typed
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.metrics.comfort import comfort
from tsbench.metrics.scd import is_scd
from tsbench.metrics.tracks import tracks_of
from tsbench.planners.base import Control, Planner, PlannerContext, Trajectory, to_command
from tsbench.planners.observation import Observation
from tsbench.planners.registry import LoadedPlanner
from tsbench.run.log.record import Record, Row
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_STEER_RAD, Motion
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import WorldSnapshot

# What is said where a table of the oracle's is missing: the released ones do not come with the package.
ORIGIN = f"{DataSet().fetch_hint('oracle')} brings the released one, tsbench oracle select makes one"

# Steps of the stored commands in a unit: 1e-3 m/s2 and 1e-4 rad. The vehicle's limits take a fifth of an int16.
STEPS = (1000, 10000)

Commands = npt.NDArray[np.int16]
Intents = tuple[tuple[int, tuple[str, ...]], ...]

# Fingerprints are of places to a tenth of a millimetre: another processor's last bits are no other drive.
_PLACES_IN_M = 1e4
_DIGEST_BYTES = 8
_DRIVES_AT_ONCE = 256
_RETRY_KEY = 0x0A
# What is kept of a try; None where the drive broke off. steps: ticks; comfort: share; mean_speed: m/s.
FIGURES = ("compliant", "engaged", "steps", "comfort", "mean_speed", "ego", "others")

_FLAT = ("scenario_id", "planner", "attempt", "part", "rank", "quality", "comfort")
_SERIES = pa.list_(pa.field("element", pa.int16(), nullable=False))
_EDGES = pa.list_(pa.field("element", pa.string(), nullable=False))
_INTENTS = pa.list_(pa.struct([pa.field("tick", pa.int32()), pa.field("edges", _EDGES)]))
_COLUMNS: list[Any] = [
    *columns(pa.string(), "scenario_id", "planner"),
    *columns(pa.int16(), "attempt"),
    *columns(pa.string(), "part"),
    *columns(pa.int16(), "rank"),
    *columns(pa.float64(), "quality", "comfort", nullable=True),
    *columns(pa.binary(_DIGEST_BYTES), "ego", "others"),
    *columns(_SERIES, "acceleration", "steering"),
    *columns(_INTENTS, "intents"),
]
SCHEMA = pa.schema(_COLUMNS).with_metadata({VERSION_KEY: "1", **OSM_LICENCE})
# High and low bytes apart: fewer bytes than dictionaries (docs/oracle.md says how many a drive takes).
_ENCODINGS = {f"{name}.list.element": "BYTE_STREAM_SPLIT" for name in ("acceleration", "steering")}


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """One drive of a scenario that obeyed and arrived.

    attempt: 0 = with the driver that the scenario's seed gives. part: of the oracle's data, `train` or `validation`.
    rank: 1 = the best of its scenario, 0 = not chosen. quality: what it was ranked by, comfort: share of steps.
    commands: (n, 2) acceleration and steering in STEPS, one row a tick. intents: (tick, edges) from which on they hold.
    ego, others: fingerprints (hex) of the ego's places and speeds, and of all other road users'.
    """

    scenario_id: str
    planner: str
    attempt: int
    part: str
    rank: int
    quality: float | None
    comfort: float | None
    commands: Commands
    intents: Intents
    ego: str
    others: str


class QuantisedPlanner:
    """A planner whose commands are rounded to what is stored, and its intents kept.

    make: makes the planner, for the first episode. attempt: above 0, it draws another driver from its seed.
    """

    def __init__(self, make: Callable[[], Planner]) -> None:
        self._make = make
        self._inner: Planner | None = None
        self.attempt = 0
        self.intents: list[tuple[int, tuple[str, ...]]] = []

    def reset(self, context: PlannerContext) -> None:
        self._network = context.network
        self.intents = []
        if self._inner is None:
            self._inner = self._make()
        self._inner.reset(replace(context, seed=retry_seed(context.seed, self.attempt)))

    def act(self, observation: Observation) -> Control | Trajectory:
        """The inner planner's command, rounded; what cannot be driven is passed on for the episode to judge."""
        assert self._inner is not None
        output = self._inner.act(observation)
        e = observation.ego
        motion = Motion(e.x, e.y, e.heading, e.speed, e.acceleration, e.steering, e.yaw_rate)
        try:
            (acceleration, steering), intent = to_command(output, motion, self._network)
        except PlannerOutputError:
            return output
        if intent != (self.intents[-1][1] if self.intents else ()):
            self.intents.append((observation.step, intent))
        return control_of(*quantise(acceleration, steering), intent)


class Replay:
    """A planner that gives the commands of a drive again. `recorded` may be exchanged between episodes."""

    def __init__(self, recorded: Recorded | None = None) -> None:
        self.recorded = recorded

    def reset(self, context: PlannerContext) -> None:  # noqa: ARG002
        assert self.recorded is not None
        self._commands: list[tuple[int, int]] = [(a, s) for a, s in self.recorded.commands.tolist()]
        self._intents = dict(self.recorded.intents)
        self._intent: tuple[str, ...] = ()

    def act(self, observation: Observation) -> Control:
        """The command of this tick. Raises SimulationError where the drive was over by now."""
        k = observation.step
        if k >= len(self._commands):
            raise SimulationError(f"the recorded drive ended after {k} ticks")
        self._intent = self._intents.get(k, self._intent)
        acceleration, steering = self._commands[k]
        return control_of(acceleration, steering, self._intent)


class Replayer:
    """Replays drives in the process's one simulation, and vouches that each is the one that was recorded."""

    def __init__(self, simulation: Simulation | None = None, loader: SceneLoader | None = None) -> None:
        self._replay = Replay()
        replay = LoadedPlanner("replay", lambda: self._replay)
        self._runner = EpisodeRunner(replay, simulation=simulation, loader=loader)

    def replay(self, recorded: Recorded, spec: ScenarioSpec) -> EpisodeFacts:
        """The drive, tick by tick. Raises SimulationError: it came out otherwise (names scenario, planner and what)."""
        self._replay.recorded = recorded
        result = self._runner.run(spec)
        differs = difference(recorded, spec, result.facts, result.error)
        if differs or result.facts is None:
            raise SimulationError(
                f"{recorded.scenario_id}: {recorded.planner}, attempt {recorded.attempt}: the replay differs from the "
                f"recorded drive: {differs} (scene, code or SUMO are others than those it was recorded with)"
            )
        return result.facts


def trajectories_path() -> Path:
    return data_file("scenarios/oracle.parquet")


def write_trajectories(drives: Iterable[Recorded], path: Path) -> None:
    """Write drives sorted by scenario, rank, planner and attempt, atomically: the same drives give the same bytes."""
    rows = sorted(drives, key=lambda r: (r.scenario_id, r.rank, r.planner, r.attempt))
    flat = {name: [getattr(row, name) for row in rows] for name in _FLAT}
    flat |= {name: [bytes.fromhex(getattr(row, name)) for row in rows] for name in ("ego", "others")}
    commands = np.concatenate([np.zeros((0, 2), dtype=np.int16), *(row.commands for row in rows)])
    offsets = np.cumsum([0, *(len(row.commands) for row in rows)], dtype=np.int32)
    arrays = [pa.array(flat[f.name], type=f.type) for f in SCHEMA if f.name in flat]
    lists: Any = pa.ListArray
    arrays += [lists.from_arrays(pa.array(offsets), pa.array(c), type=_SERIES) for c in commands.T.copy()]
    arrays += [pa.array([[{"tick": k, "edges": e} for k, e in row.intents] for row in rows], type=_INTENTS)]
    with io_errors_as_input_errors(path):
        save_table(pa.Table.from_arrays(arrays, schema=SCHEMA), path, _ENCODINGS)


def stream_trajectories(path: Path) -> Iterator[Recorded]:
    """The drives of a table, in its order; only a few hundred are objects at a time.

    Raises InputError for a missing, broken or foreign file.
    """
    table = open_table(path, SCHEMA, ORIGIN)
    for start in range(0, len(table), _DRIVES_AT_ONCE):
        yield from _recorded(table.slice(start, _DRIVES_AT_ONCE).combine_chunks())


def _recorded(table: pa.Table) -> list[Recorded]:
    flat: dict[str, list[Any]] = {name: table[name].to_pylist() for name in (*_FLAT, "ego", "others")}
    series = [pc.list_flatten(table[name]).to_numpy() for name in ("acceleration", "steering")]
    commands = np.column_stack(series).astype(np.int16)
    ends = np.cumsum([0, *pc.list_value_length(table["acceleration"]).to_pylist()])
    commands.setflags(write=False)
    intents: list[Any] = table["intents"].to_pylist()
    return [
        Recorded(
            **{name: flat[name][k] for name in _FLAT},
            commands=commands[ends[k] : ends[k + 1]],
            intents=tuple((change["tick"], tuple(change["edges"])) for change in intents[k]),
            ego=flat["ego"][k].hex(),
            others=flat["others"][k].hex(),
        )
        for k in range(len(table))
    ]


def quantise(acceleration: float, steering: float) -> tuple[int, int]:
    """A command in STEPS, within the vehicle's limits."""
    a = min(max(acceleration, -MAX_DECEL_MPS2), MAX_ACCEL_MPS2)
    s = min(max(steering, -MAX_STEER_RAD), MAX_STEER_RAD)
    return round(a * STEPS[0]), round(s * STEPS[1])


def control_of(acceleration: int, steering: int, intent: tuple[str, ...]) -> Control:
    """The command that numbers of STEPS mean."""
    return Control(acceleration / STEPS[0], steering / STEPS[1], intent)


def steps_of(commands: npt.NDArray[np.float64]) -> Commands:
    """(n, 2) driven commands, which were rounded, in STEPS."""
    return np.rint(commands * STEPS).astype(np.int16)


def retry_seed(seed: int, attempt: int) -> int:
    """The seed that a planner draws its driver from; attempt 0: the episode's own."""
    if not attempt:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(_RETRY_KEY, attempt)).generate_state(1)[0])


def fingerprints(snapshots: Sequence[WorldSnapshot]) -> tuple[str, str]:
    """(ego's, others'), 16 hex digits each, over all ticks."""
    egos = np.array([(w.ego.x, w.ego.y, w.ego.heading, w.ego.speed) for w in snapshots])
    counts = np.array([len(w.actors) for w in snapshots], dtype=np.float64)
    poses = np.concatenate([counts, *(w.actors.pose.ravel() for w in snapshots)])
    return _digest(egos), _digest(poses)


def _digest(values: npt.NDArray[np.float64]) -> str:
    # Through whole numbers: -0.0 and 0.0 are one place.
    whole = np.rint(values * _PLACES_IN_M).astype("<i8")
    return blake2b(whole.tobytes(), digest_size=_DIGEST_BYTES).hexdigest()


def difference(recorded: Recorded, spec: ScenarioSpec, facts: EpisodeFacts | None, error: str) -> str:
    """In what a replay differs, "" if in nothing."""
    if recorded.scenario_id != spec.scenario_id:
        return f"it was asked to drive {spec.scenario_id}"
    if error or facts is None:
        return error
    ticks = len(facts.snapshots) - 1
    if ticks != len(recorded.commands):
        return f"it ended ({facts.outcome}) after {ticks} ticks of {len(recorded.commands)}"
    ego, others = fingerprints(facts.snapshots)
    if ego != recorded.ego:
        return "the ego was elsewhere"
    return "" if others == recorded.others else "other road users were elsewhere"


@dataclass(frozen=True)
class Attempt(EpisodeResult):
    """The last try of an expert on a scenario. tries: what is kept of each; intents: of the last."""

    tries: tuple[Row, ...]
    intents: Intents


class OracleRunner:
    """Drives a scenario again, each time with another driver, until it succeeds.

    most: tries at most. probe: a scenario (as a mapping) on which it is found out whether the expert draws its driver
    from the seed: one that does not would only repeat its drive. options: as `EpisodeRunner`'s.
    """

    def __init__(self, planner: LoadedPlanner, *, most: int, probe: Mapping[str, Any], **options: Any) -> None:
        self._quantised = QuantisedPlanner(planner.factory)
        self._runner = EpisodeRunner(replace(planner, factory=lambda: self._quantised), **options)
        self._most, self._probe = most, typed(ScenarioSpec, probe)
        self._draws: bool | None = None

    def prepare(self, spec: ScenarioSpec) -> None:
        """As `EpisodeRunner.prepare`."""
        self._runner.prepare(spec)

    def run(self, spec: ScenarioSpec) -> Attempt:
        """The episode, as often as it takes. Raises nothing for what a scene or planner does."""
        tries: list[Row] = []
        while True:
            result = self._drive(spec, len(tries))
            tries.append(try_of(result, len(tries)))
            if tries[-1]["scd"] or len(tries) == self._most or not self._draws_driver():
                return Attempt(**vars(result), tries=tuple(tries), intents=tuple(self._quantised.intents))

    def _drive(self, spec: ScenarioSpec, attempt: int) -> EpisodeResult:
        self._quantised.attempt = attempt
        return self._runner.run(spec)

    def _draws_driver(self) -> bool:
        if self._draws is None:
            kept = self._quantised.intents
            first, second = (self._drive(self._probe, attempt).commands for attempt in (0, 1))
            self._draws = not np.array_equal(first, second)
            self._quantised.intents = kept
        return self._draws

    def close(self) -> None:
        self._runner.close()


def lost_try(outcome: str, error: str | None, attempt: int = 0) -> Row:
    """A drive that broke off, or took its worker along."""
    row: Row = dict.fromkeys(FIGURES)
    return {"attempt": attempt, "outcome": outcome, "error": error, "scd": False, **row}


def try_of(result: EpisodeResult, attempt: int) -> Row:
    facts, outcome, error = result.facts, result.outcome.value, one_line(result.error) or None
    if result.outcome.is_error or facts is None:
        return lost_try(outcome, error, attempt)
    tracks = tracks_of(facts.snapshots)
    ego, others = fingerprints(facts.snapshots)
    return {
        "attempt": attempt,
        "outcome": outcome,
        "error": error,
        "scd": is_scd(facts),
        "compliant": facts.verdicts.compliant,
        "engaged": facts.verdicts.engaged,
        "steps": facts.snapshots[-1].step,
        "comfort": comfort(tracks),
        "mean_speed": float(tracks.speed.mean()),
        "ego": ego,
        "others": others,
    }


def record_of(result: Attempt, privileged: bool) -> Record:  # noqa: ARG001
    """What a worker sends back: all tries, and the commands of the one that succeeded."""
    last = result.tries[-1]
    row: Row = {
        "planner": result.planner,
        "scenario_id": result.spec.scenario_id,
        "outcome": last["outcome"],
        "error": last["error"],
        "scd": last["scd"],
        "tries": list(result.tries),
        "commands": pack(steps_of(result.commands)) if last["scd"] else None,
        "intents": [[tick, list(edges)] for tick, edges in result.intents] if last["scd"] else None,
    }
    return Record(row, [], {}, (result.detail or result.error) if result.outcome.is_error else "")


def pack(commands: Commands) -> str:
    """Commands as text, some two bytes a tick."""
    return b64encode(zlib.compress(commands.T.astype("<i2").tobytes(), 9)).decode()


def unpack(text: str) -> Commands:
    """(n, 2) commands of `pack`."""
    return np.frombuffer(zlib.decompress(b64decode(text)), dtype="<i2").reshape(2, -1).T.astype(np.int16)
