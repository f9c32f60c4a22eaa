"""Drives and frames of them: what a planner would have seen at a tick of a drive, and what the driver then did.

Frames are made from the record of a drive (its snapshots). Drives are driven again whenever they are asked for:
deterministic simulation gives the same.
Source: docs/planners.md. Units: m, s, m/s, rad; targets are in the frame of the pose that the frame is seen from.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from tsbench.episode.observer import Observer, destination_on_map, ego_on_map
from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.traffic_view import TrafficView
from tsbench.geometry.polyline import Array
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_planner import SignTokeniser
from tsbench.learn.plant2.tokens import Pose, Tokeniser, to_frame
from tsbench.planners.observation import Observation
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.navigation import Navigator
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, Agents, WorldSnapshot

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class DriveResult:
    """What a drive gave. since: first tick that may become a frame."""

    facts: EpisodeFacts
    roads: Roads
    since: int = 0


class Drivers:
    """The simulation of a process, and all that is made once and used for many drives."""

    def __init__(self) -> None:
        self._loader, self._simulation = SceneLoader(DataSet()), Simulation()
        self._runners: dict[Hashable, object] = {}
        self._tokeniser: Tokeniser | None = None

    def kept(self, key: Hashable, make: Callable[[Simulation, SceneLoader], R]) -> R:
        """The runner of a key, always of one class; made in this process's simulation when first asked for."""
        if key not in self._runners:
            self._runners[key] = make(self._simulation, self._loader)
        return cast(R, self._runners[key])

    def roads(self, spec: ScenarioSpec) -> Roads:
        return self._loader.load(spec)[1]

    def tokeniser(self, roads: Roads, side_m: float) -> Tokeniser:
        """Of these roads, as far to the sides; the last one is kept."""
        kept = self._tokeniser
        if kept is None or kept.network is not roads.view.map or kept.side_m != side_m:
            kept = self._tokeniser = Tokeniser(roads.view.map, side_m)
        return kept

    def close(self) -> None:
        self._simulation.close()


@dataclass(frozen=True, slots=True)
class PlannerDrive:
    """A scenario driven by a planner that is named as for `tsbench run`.

    Of every kind of drive: `names` tell it from others, and draws for its frames depend on them; `facts` are all that
    decides how it goes, for JSON; `run` gives None where there are no frames.
    """

    spec: ScenarioSpec
    driver: str

    @property
    def names(self) -> tuple[str, ...]:
        return self.spec.scenario_id, self.driver

    def facts(self) -> dict[str, Any]:
        return asdict(self)

    def run(self, drivers: Drivers) -> DriveResult | None:
        """The whole episode, however it ends but by an error at once."""
        runner = drivers.kept(
            self.driver,
            lambda simulation, loader: EpisodeRunner(resolve(self.driver), simulation=simulation, loader=loader),
        )
        facts = runner.run(self.spec).facts
        return None if facts is None else DriveResult(facts, drivers.roads(self.spec))


DRIVEN = [
    ("path", np.float32, (at.PATH_POINTS, 2)),
    ("path_known", np.uint8, (at.PATH_POINTS,)),
    ("waypoints", np.float32, (at.WAYPOINTS, 2)),
    ("waypoints_known", np.uint8, (at.WAYPOINTS,)),
    ("speed", np.float32),
]
FORECAST = [
    ("forecast", np.float32, (at.OBJECTS, len(at.FORECAST_S), 2)),
    ("forecast_known", np.uint8, (at.OBJECTS, len(at.FORECAST_S))),
]
FRAME = np.dtype([*((name, at.TOKENS[name]) for name in at.TOKENS.names or ()), *DRIVEN, *FORECAST])


@dataclass(frozen=True, slots=True)
class Sampling:
    """Which frames of a drive are kept.

    every: ticks between frames. standing: of frames in which the ego stands and stays, one in so many.
    shift_m, turn_rad: of the second copy of each frame, drawn up to these to either side (the same targets).
    speed_s: the target speed is the driver's this much later, which is what makes a proportional controller keep up.
    """

    every: int = 5
    standing: int = 6
    shift_m: float = 1.0
    turn_rad: float = math.radians(5.0)
    speed_s: float = 0.7


class FrameLabeller(Protocol):
    """Says which ticks of a drive become frames, and what each should be answered with."""

    def ticks(self) -> list[int]: ...

    def fill(self, frame: at.Record, k: int, o: Observation, pose: Pose, origins: list[int]) -> None:
        """Write the targets of tick k as seen from a pose; origins: as `Tokeniser.fill` gave them."""


class Imitated:
    """Every few ticks, with what the driver did next: targets of `plant2`."""

    def __init__(self, driven: DriveResult, sampling: Sampling) -> None:
        facts, traffic_view = driven.facts, TrafficView(driven.facts.scene.network, driven.roads.view)
        self._seen, self._sampling = [traffic_view.see(w.actors, w.ego) for w in facts.snapshots], sampling
        self._track = DrivenPath(facts.snapshots)

    def ticks(self) -> list[int]:
        every = range(0, len(self._seen) - 1, self._sampling.every)
        return [k for k in every if self._track.kept(k, self._sampling)]

    def fill(self, frame: at.Record, k: int, o: Observation, pose: Pose, origins: list[int]) -> None:
        del o
        self._track.targets(frame, k, pose, self._sampling.speed_s)
        _forecast(frame, self._seen, k, origins)


def frames_of(
    driven: DriveResult,
    encoder: Tokeniser | SignTokeniser,
    teacher: FrameLabeller,
    sampling: Sampling,
    rng: np.random.Generator,
    dtype: np.dtype[np.void],
    perception: Perception = EXACTLY,
    luck: str = "",
) -> at.Records:
    """(n,) of `dtype`: every tick that the teacher takes as it was seen, and as it would be from a pose beside it.

    perception, luck: as `episode.observer.Observer`'s.
    """
    chosen = set(teacher.ticks())
    frames: at.Records = np.zeros(2 * len(chosen), dtype=dtype)
    row = 0
    for k, o in enumerate(observations(driven.facts, driven.roads, perception, luck)):
        encoder.watch(o)
        if k not in chosen:
            continue
        pose = (o.ego.x, o.ego.y, o.ego.heading)
        for here in (pose, _beside(pose, sampling, rng)):
            teacher.fill(frames[row], k, o, here, encoder.fill(frames[row], o, here))
            row += 1
    return frames


def observations(
    facts: EpisodeFacts, roads: Roads, perception: Perception = EXACTLY, luck: str = ""
) -> Iterator[Observation]:
    """What a planner saw at each tick of a drive: the same observer and navigator over the same snapshots."""
    view = roads.view
    observer = Observer(facts.scene, view, perception, luck)
    navigator = Navigator(view.graph, destination_on_map(view, facts.scene))
    for snapshot in facts.snapshots:
        seen = ego_on_map(view, snapshot.ego)
        yield observer.observe(snapshot, seen, navigator.update(seen))


class DrivenPath:
    """The driven way of an episode: what path and speed targets are read from.

    s: (n,) m driven until each tick; xy: (n, 2); speed: (n,).
    """

    def __init__(self, snapshots: list[WorldSnapshot]) -> None:
        self.xy: Array = np.array([(w.ego.x, w.ego.y) for w in snapshots])
        self.speed: Array = np.array([w.ego.speed for w in snapshots])
        self.s: Array = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.xy, axis=0).T))))
        self._tick = np.arange(len(snapshots), dtype=np.float64)

    def place_at(self, axis: Array, where: Array) -> Array:
        """(k, 2) places on the way, by ticks or by metres."""
        return np.column_stack([np.interp(where, axis, self.xy[:, i]) for i in (0, 1)])

    def targets(self, frame: at.Record, k: int, pose: Pose, speed_s: float) -> None:
        """Path, waypoints and target speed after tick k, as seen from a pose."""
        metres: Array = self.s[k] + at.PATH_STEP_M * np.arange(1.0, at.PATH_POINTS + 1)
        frame["path"] = to_frame(self.place_at(self.s, metres), pose)
        frame["path_known"] = metres <= self.s[-1]
        ticks: Array = k + at.WAYPOINT_S / DT_S * np.arange(1.0, at.WAYPOINTS + 1)
        frame["waypoints"] = to_frame(self.place_at(self._tick, ticks), pose)
        frame["waypoints_known"] = ticks <= self._tick[-1]
        frame["speed"] = np.interp(k + speed_s / DT_S, self._tick, self.speed)

    def kept(self, k: int, sampling: Sampling) -> bool:
        """Is it not one of the many ticks in which the ego stands and stays?"""
        later = self.s[min(k + round(2.0 / DT_S), len(self.s) - 1)]
        stands = self.speed[k] < 0.1 and later - self.s[k] < 0.1
        return not stands or (k // sampling.every) % sampling.standing == 0


def _beside(pose: Pose, sampling: Sampling, rng: np.random.Generator) -> Pose:
    x, y, heading = pose
    shift = float(rng.uniform(-sampling.shift_m, sampling.shift_m))
    turn = float(rng.uniform(-sampling.turn_rad, sampling.turn_rad))
    return x - shift * math.sin(heading), y + shift * math.cos(heading), heading + turn


def _forecast(frame: at.Record, seen: Sequence[Agents], k: int, origins: list[int]) -> None:
    """How far each object in a slot moves, ahead and left of its own heading; unknown once it is out of sight."""
    now = seen[k]
    for j, span in enumerate(at.FORECAST_S):
        then = k + round(span / DT_S)
        if then >= len(seen):
            return
        later = seen[then]
        rows = {index: row for row, index in enumerate(later.ids.tolist())}
        for slot, origin in enumerate(origins):
            if origin < 0:
                frame["forecast_known"][slot, j] = 1
                continue
            row = rows.get(int(now.ids[origin]))
            if row is not None:
                x, y, heading = now.pose[origin].tolist()
                frame["forecast"][slot, j] = to_frame(later.pose[row : row + 1, :2], (x, y, heading))[0]
                frame["forecast_known"][slot, j] = 1
