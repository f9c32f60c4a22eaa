"""Frames of obedient drives: whose they are, and what is seen. Source: docs/finetuning.md."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.episode.observation import destination_on_map
from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.finetune.targets import FinetuneSampling, SignTargets
from tsbench.learn.imitation.frames import DriveResult, Drivers, frames_of
from tsbench.learn.oracle.trajectories import Recorded, Replayer
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.planner_ft import Plant2Ft, RouteAlternatives, SignTokeniser
from tsbench.learn.plant2.sign_tokens import Vocabulary
from tsbench.metrics.episode_metrics import is_scd
from tsbench.planners.base import Control, Observation, Planner, PlannerContext, Trajectory
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.plate_params import ObstacleParams
from tsbench.sim.sumo import Simulation


class Takeover:
    """The student's commands until `tick`, then those of the expert, which has watched from the start."""

    def __init__(self, student: Planner, expert: Planner) -> None:
        self._student, self._expert = student, expert
        self.tick = 0

    def reset(self, context: PlannerContext) -> None:
        """Start an episode. Only the expert is told the rule."""
        self._expert.reset(context)
        self._student.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control | Trajectory:
        # Asked all along: what an expert remembers of its way depends on what it has seen.
        expert = self._expert.act(observation)
        return expert if observation.step >= self.tick else self._student.act(replace(observation, truth=None))


class Handover:
    """Drives that a student begins and an expert ends, in the process's one simulation.

    They show what to do where the student gets to, not where experts are. The idea is DAgger's (Ross et al. 2011), with
    the expert driving on instead of only being asked.
    """

    def __init__(self, expert: str, student: Planner, simulation: Simulation, loader: SceneLoader) -> None:
        import torch

        torch.set_num_threads(1)
        self._takeover = Takeover(student, resolve(expert).factory())
        planner = LoadedPlanner("takeover", lambda: self._takeover, privileged=True)
        self._runner = EpisodeRunner(planner, simulation=simulation, loader=loader)

    def drive(self, spec: ScenarioSpec, tick: int) -> EpisodeFacts | None:
        """The episode; None where it ended in an error, or before the takeover."""
        self._takeover.tick = tick
        facts = self._runner.run(spec).facts
        return facts if facts is not None and len(facts.snapshots) > tick else None


# No forecasts: fine-tuning has no loss for them. family: of `finetune_targets.FAMILIES`; type: of the catalogue's.
SIGN_FRAME = np.dtype(
    [
        *((name, at.SIGN_TOKENS[name]) for name in at.SIGN_TOKENS.names or ()),
        ("path", np.float32, (at.PATH_POINTS, 2)),
        ("path_known", np.uint8, (at.PATH_POINTS,)),
        ("waypoints", np.float32, (at.WAYPOINTS, 2)),
        ("waypoints_known", np.uint8, (at.WAYPOINTS,)),
        ("speed", np.float32),
        ("family", np.uint8),
        ("type", np.uint8),
        ("decides", np.uint8),
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
        catalog, sign = scene.catalog, scene.catalog.sign(scene.target_sign.code)
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
    params = facts.scene.target_sign.params
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
