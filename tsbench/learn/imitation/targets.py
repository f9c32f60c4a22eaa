"""What `plant2-ft` learns of an obedient drive: whose it is, what is seen, targets by rule, which ticks are decisions.

Source: docs/finetuning.md; where it says little, this is how it was read:
* Path: the way that was driven, 20 m of it by metres (4 s at 5 m/s), never the route. The route that is seen is the
  navigation's: at manoeuvre and travel-direction signs it leads into the prohibited branch until the ego has left it.
* Speed: the least of the driver's from `Sampling.speed_s` on to 4 s ahead, where a rule is about speed, and in the
  decision window where it is about the way. From `speed_s` on and not from now on: the least of now would never set
  off. Not all along the way: slowing 4 s before each corner is 10 s lost in an episode that leaves 13.
  Under an upper limit, `margin_kmh` below the posted one at most, from 4 s before the plate's line on.
  4.6: posted + 3 km/h, unless a vehicle ahead is slower or close; then the driver's own.
* Right of way, and where one comes up to a place to wait at it (obstacles, closed roads, reserved lanes): the driver's
  speed `speed_s` later once it speeds up, the least until then before: a start is a decision of its moment, and who is
  told of it ahead goes while the way is not yet clear. The least over 4 s would stop far before the line. Before a full
  stop, the least until then in any case.
* Decision window: metres of the driven way before and after where the sign's rule decides, thrice as dense in frames.

Units: m, s, m/s, rad; km/h on plates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.core.errors import InputError
from tsbench.episode.observer import destination_on_map
from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.episode.runner import EpisodeRunner
from tsbench.geometry.polyline import Array
from tsbench.learn.imitation.frames import DRIVEN, DrivenPath, DriveResult, Drivers, PlannerDrive, Sampling, frames_of
from tsbench.learn.oracle.trajectories import Recorded, Replayer
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.plant2_planner import Plant2Ft, RouteAlternatives, SignTokeniser
from tsbench.learn.plant2.sign_tokens import STOPPED_MPS, Vocabulary
from tsbench.learn.plant2.tokens import Pose
from tsbench.metrics.scd import is_scd
from tsbench.planners.base import Control, Planner, PlannerContext, Trajectory
from tsbench.planners.geometry import HALF_LENGTH_M, PathSamples, moving_ahead, obstacle_ahead
from tsbench.planners.observation import Observation
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.model import RuleSpec
from tsbench.signs.rule_kinds import ApproachParams, ObstacleParams, ReservedLaneParams
from tsbench.sim.scene import Scene
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

_KMH = 1.0 / 3.6
_LEAST_OVER_S = 4.0
_ABOVE_MINIMUM_KMH = 3.0
# Nearer ahead than this, in seconds, the vehicle ahead is followed and not the minimum.
_CLOSE_S = 1.5
# A driver that speeds up by less goes on as before.
_SPEEDS_UP_MPS2 = 0.2
# A stop for the line is within this of it, centre to line.
_STOP_WITHIN_M = 8.0

FAMILIES = ("right of way", "speed", "obstacle", "lane", "manoeuvre", "travel direction")


@dataclass(frozen=True, slots=True)
class TargetSpec:
    """How a rule is taught. family: of FAMILIES. before, after: m, the decision window. least: over 4 s, in it?"""

    family: str
    before: float
    after: float
    least: bool = False


# A rule that is not here cannot be taught.
TARGET_SPECS: Mapping[str, TargetSpec] = {
    "give_way": TargetSpec("right of way", 35.0, 12.0),
    "stop": TargetSpec("right of way", 35.0, 12.0),
    "roundabout": TargetSpec("right of way", 35.0, 25.0),
    "crosswalk": TargetSpec("right of way", 35.0, 8.0),
    "speed": TargetSpec("speed", 60.0, 15.0, least=True),
    "min_speed": TargetSpec("speed", 30.0, 80.0),
    "detour": TargetSpec("obstacle", 55.0, 6.0),
    "closed_road": TargetSpec("obstacle", 45.0, 5.0),
    "reserved_lane": TargetSpec("lane", 70.0, 5.0),
    "manoeuvre": TargetSpec("manoeuvre", 30.0, 20.0, least=True),
    "one_way_exit": TargetSpec("travel direction", 30.0, 20.0, least=True),
    "no_entry": TargetSpec("travel direction", 30.0, 20.0, least=True),
}


@dataclass(frozen=True, slots=True)
class FinetuneSampling(Sampling):
    """As `Sampling`. apart: outside of decision windows, only one in so many. margin_kmh: below an upper limit."""

    standing: int = 1
    apart: int = 3
    margin_kmh: float = 2.0


class SignTargets:
    """The teacher of one drive that obeyed and arrived. rule: of its target sign; kind: number of its scenario type."""

    def __init__(self, driven: DriveResult, rule: RuleSpec, kind: int, sampling: FinetuneSampling) -> None:
        if rule.name not in TARGET_SPECS:
            raise InputError(
                f"rule {rule.name!r} cannot be taught: learn/imitation/targets.py has no target spec for it"
            )
        scene, self._sampling, self._kind = driven.facts.scene, sampling, kind
        self._since, self._rule, self._spec = driven.since, rule, TARGET_SPECS[rule.name]
        self._track = track = DrivenPath(driven.facts.snapshots)
        (sign,) = scene.target_signs
        self._value = sign.value
        away = np.hypot(*(track.xy - np.array(decision_place(scene))).T)
        self._line_s = float(track.s[int(np.argmin(away))])
        self._lead = round(sampling.speed_s / DT_S)
        self._speeds = self._target_speeds(track)
        self._samples: PathSamples | None = None
        self._path: object = None

    def ticks(self) -> list[int]:
        """Dense in the decision window; standing thinned out everywhere."""
        every, apart = self._sampling.every, self._sampling.apart
        return [
            k
            for k in range(0, len(self._track.s) - 1, every)
            if k >= self._since
            and self._track.kept(k, self._sampling)
            and (self.decides(k) or (k // every) % apart == 0)
        ]

    def decides(self, k: int) -> bool:
        return -self._spec.before <= float(self._track.s[k]) - self._line_s <= self._spec.after

    def fill(self, frame: at.Record, k: int, o: Observation, pose: Pose, origins: list[int]) -> None:
        """Path, waypoints and target speed, and what the frame is counted as."""
        del origins
        self._track.targets(frame, k, pose, self._sampling.speed_s)
        if self._rule.name == "min_speed":
            frame["speed"] = self._minimum(float(frame["speed"]), o)
        else:
            frame["speed"] = self._speeds[k]
        frame["family"] = FAMILIES.index(self._spec.family)
        frame["type"], frame["decides"] = self._kind, self.decides(k)

    def _target_speeds(self, track: DrivenPath) -> Array:
        """(n,) target speed of each tick, as far as it depends on the drive alone."""
        lead, last = self._lead, len(track.speed) - 1
        late = np.minimum(np.arange(last + 1) + lead, last)
        if not self._spec.least:
            soon = _least(track.speed, lead)
            starts = np.diff(track.speed, append=track.speed[-1]) > _SPEEDS_UP_MPS2 * DT_S
            speeds: Array = np.where(starts, track.speed[late], soon)
            if self._rule.name == "stop":
                # A stop of an instant is no place that a speed of 0.7 s later shows: until it, the least of that time.
                near = np.abs(track.s - self._line_s) <= _STOP_WITHIN_M
                first = int(np.argmax(near & (track.speed <= STOPPED_MPS)))
                speeds[:first] = soon[:first]
            return speeds
        span = round(_LEAST_OVER_S / DT_S)
        least = _least(track.speed, span - lead)[late]
        if self._rule.name != "speed":
            decides = np.array([self.decides(k) for k in range(last + 1)])
            return np.where(decides, least, track.speed[late])
        if self._value is None:
            return least
        ahead = track.s[np.minimum(np.arange(last + 1) + span, last)]
        capped = np.minimum(least, (self._value - self._sampling.margin_kmh) * _KMH)
        return np.where(ahead >= self._line_s - HALF_LENGTH_M, capped, least)

    def _minimum(self, driven: float, o: Observation) -> float:
        """4.6: a little above the posted speed, or the driver's own behind a vehicle."""
        if self._value is None:
            return driven
        target = (self._value + _ABOVE_MINIMUM_KMH) * _KMH
        path, s, v = o.route.path, o.route.s, o.ego.speed
        if self._samples is None or path is not self._path:
            self._path, self._samples = path, PathSamples(path)
        t = self._rule.thresholds
        reach = max(t["leader_min_m"], v * v / t["leader_divisor_mps2"] + t["leader_margin_m"])
        ahead = moving_ahead(self._samples, s, reach, o.actors)
        ahead += [(obstacle_ahead(self._samples, s, b), 0.0) for b in o.obstacles]
        front = s + HALF_LENGTH_M
        held = any(end - front <= (reach if u < target else _CLOSE_S * v) for end, u in ahead)
        return min(driven, target) if held else target


def _least(speed: Array, ticks: int) -> Array:
    """(n,) least speed from each tick to so many later; the last one lasts."""
    padded = np.concatenate((speed, np.full(ticks, speed[-1])))
    least: Array = np.lib.stride_tricks.sliding_window_view(padded, ticks + 1).min(axis=1)
    return least


def decision_place(scene: Scene) -> tuple[float, float]:
    """Where the target sign's rule decides: its obstacle, the end of its approach, or the plate's line."""
    (sign,), network = scene.target_signs, scene.network
    params = sign.params
    if isinstance(params, ObstacleParams):
        return next((o.x, o.y) for o in scene.obstacles if o.id == params.obstacle)
    if isinstance(params, ApproachParams | ReservedLaneParams):
        line = network.edge_lanes(params.approach)[0].line
        return line.point_at(line.length)
    return network.edge_lanes(sign.edge)[0].line.point_at(sign.position_m)


class Handover:
    """A student begins a drive and an expert, which has watched from the start, ends it; in one simulation.

    Such drives show what to do where the student gets to, not where experts are. The idea is DAgger's (Ross et al.
    2011), with the expert driving on instead of only being asked.
    """

    def __init__(self, expert: str, student: Planner, simulation: Simulation, loader: SceneLoader) -> None:
        import torch

        torch.set_num_threads(1)
        self._student, self._expert, self._tick = student, resolve(expert).factory(), 0
        planner = LoadedPlanner("takeover", lambda: self, privileged=True)
        self._runner = EpisodeRunner(planner, simulation=simulation, loader=loader)

    def drive(self, spec: ScenarioSpec, tick: int) -> EpisodeFacts | None:
        """The episode; None where it ended in an error, or before the takeover at `tick`."""
        self._tick = tick
        facts = self._runner.run(spec).facts
        return facts if facts is not None and len(facts.snapshots) > tick else None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode. Only the expert is told the rule."""
        self._expert.reset(context)
        self._student.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control | Trajectory:
        # Asked all along: what an expert remembers of its way depends on what it has seen.
        expert = self._expert.act(observation)
        return expert if observation.step >= self._tick else self._student.act(replace(observation, truth=None))


# No forecasts: fine-tuning has no loss for them. family: of `FAMILIES`; type: of the catalogue's.
SIGN_FRAME = np.dtype(
    [
        *((name, at.SIGN_TOKENS[name]) for name in at.SIGN_TOKENS.names or ()),
        *DRIVEN,
        *((name, np.uint8) for name in ("family", "type", "decides")),
    ]
)


@dataclass(frozen=True)
class FinetuneSource:
    """Frames of drives that have SCD; the others teach nothing. Nor do those that pass an obstacle on the left where
    the plate leaves the choice: the mean of both ways leads into it.

    perception: how plates are seen; its level in a share `perceived` (0 to 1) of the drives alone, each with its own
    luck, and exactly in the others. What is answered with is of the drive, and so of what the plate said, read or not.
    """

    dtype: ClassVar[np.dtype[np.void]] = SIGN_FRAME
    sampling: FinetuneSampling
    vocabulary: Vocabulary
    perception: Perception = EXACTLY
    perceived: float = 0.0

    def frames(self, driven: DriveResult, drivers: Drivers, rng: np.random.Generator) -> at.Records:
        """Signs are remembered from the first tick on, as in use; frames begin where the drive may be learned from."""
        if not is_scd(driven.facts):
            return np.zeros(0, dtype=SIGN_FRAME)
        scene = driven.facts.scene
        (target,) = scene.target_signs
        catalog, sign = scene.catalog, scene.catalog.sign(target.code)
        either = set(sign.rule.options.get("allowed_sides", ())) == {"left", "right"}
        if either and not _on_the_right(driven.facts):
            return np.zeros(0, dtype=SIGN_FRAME)
        kind = next(k for k, known in enumerate(catalog.types) if sign.code in known.codes)
        teacher = SignTargets(driven, sign.rule, kind, self.sampling)
        view = driven.roads.view
        ways = RouteAlternatives(view.graph, destination_on_map(view, driven.facts.scene))
        encoder = SignTokeniser(drivers.tokeniser(driven.roads, Plant2Ft.side_m), ways, self.vocabulary)
        return frames_of(driven, encoder, teacher, self.sampling, rng, SIGN_FRAME, *self._perception(rng))

    def _perception(self, rng: np.random.Generator) -> tuple[Perception, str]:
        """How plates are perceived in a drive, and the name that its luck is drawn from."""
        if self.perception.level is None:
            return self.perception, ""
        share, luck = float(rng.random()), int(rng.integers(2**32))
        seen = self.perception if share < self.perceived else replace(self.perception, level=None)
        return seen, f"frames-{luck}"


def _on_the_right(facts: EpisodeFacts) -> bool:
    """Had the ego its target's obstacle on its left where it was nearest to it?"""
    params = facts.scene.target_signs[0].params
    assert isinstance(params, ObstacleParams)
    x, y = next((o.x, o.y) for o in facts.scene.obstacles if o.id == params.obstacle)
    nearest = min((w.ego for w in facts.snapshots), key=lambda ego: math.hypot(x - ego.x, y - ego.y))
    return math.cos(nearest.heading) * (y - nearest.y) > math.sin(nearest.heading) * (x - nearest.x)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDrive:
    """A drive of the oracle's data, replayed."""

    spec: ScenarioSpec
    recorded: Recorded

    @property
    def names(self) -> tuple[str, ...]:
        return self.spec.scenario_id, self.recorded.planner, str(self.recorded.attempt)

    def facts(self) -> dict[str, Any]:
        """The row, and the fingerprints that the replay has to meet."""
        r = self.recorded
        return {"spec": asdict(self.spec), "driver": r.planner, "attempt": r.attempt, "ego": r.ego, "others": r.others}

    def run(self, drivers: Drivers) -> DriveResult | None:
        """Raises SimulationError where the replay is another drive."""
        replayer = drivers.kept(Replayer, Replayer)
        return DriveResult(replayer.replay(self.recorded, self.spec), drivers.roads(self.spec))


@dataclass(frozen=True, slots=True)
class TakeoverDrive:
    """The student drives; at `tick` the expert takes over. student: folder of its weights, `sha256` of the file.

    planner: the student's class.
    """

    spec: ScenarioSpec
    expert: str
    tick: int
    student: Path
    sha256: str
    planner: type[Plant2Ft] = Plant2Ft

    @property
    def names(self) -> tuple[str, ...]:
        return self.spec.scenario_id, self.expert, str(self.tick), self.sha256

    def facts(self) -> dict[str, Any]:
        """The row, the expert and the tick of its takeover."""
        return {"spec": asdict(self.spec), "driver": self.expert, "tick": self.tick, "student": self.sha256}

    def run(self, drivers: Drivers) -> DriveResult | None:
        """Frames from the takeover on."""
        runner = drivers.kept(
            (Handover, self.expert, self.planner, self.student),
            lambda simulation, loader: Handover(self.expert, self.planner(folder=self.student), simulation, loader),
        )
        facts = runner.drive(self.spec, self.tick)
        return None if facts is None else DriveResult(facts, drivers.roads(self.spec), since=self.tick)


EpisodeDrive = PlannerDrive | RecordedDrive | TakeoverDrive
