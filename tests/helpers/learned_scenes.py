"""Observations of a short drive, and learned planners with random weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from planner_loop import Body, World, cones, constant, load

from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.oracle.trajectories import QuantisedPlanner, Recorded, fingerprints, steps_of
from tsbench.learn.rl.ppo_planner import SIZE
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.lane_change import pursue_route
from tsbench.planners.observation import Observation, SignView
from tsbench.planners.registry import resolve
from tsbench.planners.weights import Tensors, save_weights
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import ActorKind

SPEED = 8.0
START_M = 10.0


class Recorder:
    """Rolls on along the route and keeps what it sees."""

    def __init__(self) -> None:
        self.context: PlannerContext
        self.seen: list[Observation] = []

    def reset(self, context: PlannerContext) -> None:
        self.context = context

    def act(self, observation: Observation) -> Control:
        self.seen.append(observation)
        return Control(0.0, pursue_route(observation))


def record(seconds: float = 2.0) -> Recorder:
    """Behind a car, beside a waiting pedestrian, before cones, on the way through a crossroads."""
    network = load("cross")
    lane = network.lane("sc_0")
    leader = Body("leader", ("sc_0",), START_M + 25.0, constant(SPEED), ("sc", "cn"))
    walker = Body("walker", ("sc_0",), START_M + 15.0, constant(0.0), (), ActorKind.PEDESTRIAN, 0.4, 0.4)
    world = World(
        network, "sc_0", START_M, SPEED, Destination("cn", 60.0), bodies=[leader, walker],
        obstacles=cones(lane, START_M + 40.0),
    )  # fmt: skip
    world.lateral["walker"] = -4.0
    recorder = Recorder()
    world.run(recorder, seconds)
    return recorder


def recorded_drive(
    name: str, row: ScenarioSpec, simulation: Simulation, loader: SceneLoader
) -> tuple[EpisodeResult, Recorded]:
    """A drive of a planner, with its commands as they are stored."""
    expert = resolve(name)
    rounded = QuantisedPlanner(expert.factory)
    runner = EpisodeRunner(replace(expert, factory=lambda: rounded), simulation=simulation, loader=loader)
    result = runner.run(row)
    ego, others = fingerprints(result.facts.snapshots)
    return result, Recorded(
        scenario_id=row.scenario_id, planner=name, attempt=0, part="train", rank=1, quality=0.5, comfort=None,
        commands=steps_of(result.commands), intents=tuple(rounded.intents), ego=ego, others=others,
    )  # fmt: skip


def with_signs(observation: Observation) -> Observation:
    ego = observation.ego
    plates = tuple(
        SignView(code, value, ego.x + 20.0, ego.y + 3.0, 1.0, "sc", -1, 60.0, 20.0 + k)
        for k, (code, value) in enumerate((("3.24", 20.0), ("2.5", None), ("3.1", None)))
    )
    return replace(observation, signs=plates)


def ppo_tensors(seed: int = 0) -> Tensors:
    rng = np.random.default_rng(seed)
    sizes = {"hidden.0": (256, SIZE), "hidden.1": (256, 256), "action": (2, 256)}
    tensors = {f"{n}.weight": rng.normal(0, 0.1, s).astype(np.float32) for n, s in sizes.items()}
    tensors |= {f"{n}.bias": np.zeros(s[0], dtype=np.float32) for n, s in sizes.items()}
    return tensors | {"action.log_std": np.full(2, -1.4, dtype=np.float32)}


def save_ppo(folder: Path) -> Path:
    save_weights("ppo", folder, ppo_tensors(), {})
    return folder


def save_carl(folder: Path) -> Path:
    import torch

    from tsbench.learn.rl.policy import CarlActor

    torch.manual_seed(0)
    save_weights("carl", folder, {k: v.numpy() for k, v in CarlActor().state_dict().items()}, {})
    return folder
