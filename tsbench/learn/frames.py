"""Training frames: what a planner would have seen at a tick of a drive, and what the driver then did.

Frames are made from the record of a drive (its snapshots), which deterministic simulation gives again at any time.
Source: spec/planners.md. Units: m, s, m/s, rad; targets are in the frame of the pose that the frame is seen from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsbench.geometry.polyline import Array
from tsbench.metrics.outcome import EpisodeFacts
from tsbench.planners.base import Observation
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.tokens import Pose, Tokeniser, to_frame
from tsbench.run.observe import Observer
from tsbench.scenarios.load import Roads
from tsbench.sim.navigation import Navigator
from tsbench.sim.world import DT_S, WorldSnapshot

TARGETS = [
    ("path", np.float32, (at.PATH_POINTS, 2)),
    ("path_known", np.uint8, (at.PATH_POINTS,)),
    ("waypoints", np.float32, (at.WAYPOINTS, 2)),
    ("waypoints_known", np.uint8, (at.WAYPOINTS,)),
    ("speed", np.float32),
    ("forecast", np.float32, (at.OBJECTS, len(at.FORECAST_S), 2)),
    ("forecast_known", np.uint8, (at.OBJECTS, len(at.FORECAST_S))),
]
FRAME = np.dtype([*((name, at.TOKENS[name]) for name in at.TOKENS.names or ()), *TARGETS], align=True)


@dataclass(frozen=True, slots=True)
class Sampling:
    """Which frames of a drive are kept.

    every: ticks between frames. standing: of frames in which the ego stands and stays, one in so many.
    shift_m, turn_rad: of the second copy of each frame, drawn up to these to either side (the same targets).
    speed_s: the wished speed is the driver's this much later, which is what makes a proportional controller keep up.
    """

    every: int = 5
    standing: int = 6
    shift_m: float = 1.0
    turn_rad: float = math.radians(5.0)
    speed_s: float = 0.7


def frames_of(
    facts: EpisodeFacts, roads: Roads, tokeniser: Tokeniser, sampling: Sampling, rng: np.random.Generator
) -> at.Records:
    """(n,) of FRAME: every kept tick as it was seen, and as it would be from a pose beside it."""
    seen = observations(facts, roads)
    track = Track(facts.snapshots)
    chosen = [k for k in range(0, len(seen) - 1, sampling.every) if _kept(track, k, sampling)]
    frames: at.Records = np.zeros(2 * len(chosen), dtype=FRAME)
    for row, k in enumerate(chosen):
        o = seen[k]
        pose = (o.ego.x, o.ego.y, o.ego.heading)
        for frame, here in ((frames[2 * row], pose), (frames[2 * row + 1], _beside(pose, sampling, rng))):
            origins = tokeniser.fill(frame, o, here)
            track.targets(frame, k, here, sampling.speed_s)
            _forecast(frame, facts.snapshots, k, origins)
    return frames


def observations(facts: EpisodeFacts, roads: Roads) -> list[Observation]:
    """What a planner saw at each tick of a drive: the same observer and navigator over the same snapshots."""
    observer, navigator = (
        Observer(facts.scene, mask_signs=False),
        Navigator(roads.graph, facts.scene.destination),
    )
    return [observer.observe(snapshot, navigator.update(snapshot.ego)) for snapshot in facts.snapshots]


class Track:
    """The driven way of an episode: what path and speed targets are read from.

    s: (n,) m driven until each tick; xy: (n, 2); speed: (n,).
    """

    def __init__(self, snapshots: list[WorldSnapshot]) -> None:
        self.xy: Array = np.array([(w.ego.x, w.ego.y) for w in snapshots])
        self.speed: Array = np.array([w.ego.speed for w in snapshots])
        self.s: Array = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.xy, axis=0).T))))
        self._tick = np.arange(len(snapshots), dtype=np.float64)

    def at(self, axis: Array, where: Array) -> Array:
        """(k, 2) places on the way, by ticks or by metres."""
        return np.column_stack([np.interp(where, axis, self.xy[:, i]) for i in (0, 1)])

    def targets(self, frame: np.void, k: int, pose: Pose, speed_s: float) -> None:
        """Path, waypoints and wished speed after tick k, as seen from a pose."""
        metres: Array = self.s[k] + at.PATH_STEP_M * np.arange(1.0, at.PATH_POINTS + 1)
        frame["path"] = to_frame(self.at(self.s, metres), pose)
        frame["path_known"] = metres <= self.s[-1]
        ticks: Array = k + at.WAYPOINT_S / DT_S * np.arange(1.0, at.WAYPOINTS + 1)
        frame["waypoints"] = to_frame(self.at(self._tick, ticks), pose)
        frame["waypoints_known"] = ticks <= self._tick[-1]
        frame["speed"] = np.interp(k + speed_s / DT_S, self._tick, self.speed)


def _kept(track: Track, k: int, sampling: Sampling) -> bool:
    later = track.s[min(k + round(2.0 / DT_S), len(track.s) - 1)]
    stands = track.speed[k] < 0.1 and later - track.s[k] < 0.1
    return not stands or (k // sampling.every) % sampling.standing == 0


def _beside(pose: Pose, sampling: Sampling, rng: np.random.Generator) -> Pose:
    x, y, heading = pose
    shift = float(rng.uniform(-sampling.shift_m, sampling.shift_m))
    turn = float(rng.uniform(-sampling.turn_rad, sampling.turn_rad))
    return x - shift * math.sin(heading), y + shift * math.cos(heading), heading + turn


def _forecast(frame: np.void, snapshots: list[WorldSnapshot], k: int, origins: list[int]) -> None:
    """How far each object in a slot moves, ahead and left of its own heading; unknown once it is out of sight."""
    now = snapshots[k].actors
    for j, span in enumerate(at.FORECAST_S):
        then = k + round(span / DT_S)
        if then >= len(snapshots):
            return
        later = snapshots[then].actors
        rows = {index: row for row, index in enumerate(later.index.tolist())}
        for slot, origin in enumerate(origins):
            if origin < 0:
                frame["forecast_known"][slot, j] = 1
                continue
            row = rows.get(int(now.index[origin]))
            if row is not None:
                x, y, heading = now.pose[origin].tolist()
                frame["forecast"][slot, j] = to_frame(later.pose[row : row + 1, :2], (x, y, heading))[0]
                frame["forecast_known"][slot, j] = 1
