"""How a training begins: the policy imitates a teacher, and the critic learns what that earns.

This spares the hours in which a fresh policy finds out to stop behind a leader; PPO goes on from there.
The teacher labels each state with its own action. At first the teacher drives, then more and more the policy, so that
the policy learns from its own mistakes (DAgger, Ross et al., arXiv 1011.0686). The states in memory are learned again
and again. Noise is added to the driven actions and not to the learned ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import mse_loss

from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.learn.rl.actions import action_for
from tsbench.planners.base import PlannerContext
from tsbench.planners.experts.rules.obstacle_pass import ObstaclePass
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation
from tsbench.roads.road_map import RoadMap

_OTHER = {"right": "left", "left": "right"}
_AHEAD_S, _LEAST_AHEAD_M = 0.9, 5.0


class Demonstrator:
    """The teacher of `ppo` and `carl`: `idm`, which also passes an obstacle on its lane. Blind to signs.

    Which side is allowed is what a plate says. The teacher takes the lane towards the kerb wherever there is one: of
    two sides that are as good, a pupil without memory would learn the middle, which is the obstacle.
    """

    def __init__(self) -> None:
        self._idm = Idm()
        self._context: PlannerContext
        self._detour: ObstaclePass | None = None

    def reset(self, context: PlannerContext) -> None:
        self._context, self._detour = context, None
        self._idm.reset(context)

    def advise(self, observation: Observation) -> tuple[float, float]:
        """Acceleration (m/s2), and how far beside the route to aim (m, left positive); at every decision."""
        o = observation
        if self._detour is None:
            if not o.obstacles:
                return self._idm.act(o).acceleration, 0.0
            self._detour = ObstaclePass(self._context, *_one_side(o, self._context.network))
        way = self._detour.route(o)
        least, most = self._detour.acceleration_bounds(o, way)
        wished = self._idm.act(o if way is o.route else replace(o, route=way)).acceleration
        acceleration = min(max(wished, least), most)
        if way is o.route:
            return acceleration, 0.0
        point = way.path.line.point_at(way.s + max(_LEAST_AHEAD_M, _AHEAD_S * o.ego.speed))
        return acceleration, o.route.path.line.project(*point)[1]


def _one_side(o: Observation, roads: RoadMap) -> tuple[str, str]:
    """Which obstacle, here the nearest, and which side will do."""
    nearest = min(o.obstacles, key=lambda thing: (math.hypot(thing.x - o.ego.x, thing.y - o.ego.y), thing.id))
    free = roads.outer(roads.lane(nearest.lane)) >= 0
    return nearest.id, roads.kerb_side if free else _OTHER[roads.kerb_side]


Array = npt.NDArray[Any]

_NOISE = 0.25
_RATE, _LAST_RATE = 1e-3, 5e-5
_BYTES = 3_000_000_000


class DaggerWrapper(gymnasium.Wrapper[Any, npt.NDArray[np.float32], Any, npt.NDArray[np.float32]]):
    """A driving environment that also says what the teacher would do."""

    def __init__(self, env: gymnasium.Env[Any, npt.NDArray[np.float32]]) -> None:
        super().__init__(env)
        self._teacher = Demonstrator()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        found = self.env.reset(seed=seed, options=options)
        self._teacher.reset(self._drive.episode.context)
        return found

    def advise(self) -> npt.NDArray[np.float32]:
        """(2,) the action that comes closest to what the teacher does now; once per step."""
        return np.array(action_for(*self._teacher.advise(self._drive.episode.observation)), dtype=np.float32)

    @property
    def _drive(self) -> DriveEnv:
        return cast("DriveEnv", self.env.unwrapped)


class ReplayMemory:
    """What was seen, advised and earned: all of `decisions`, or the last so many bytes of it."""

    def __init__(self, example: RolloutBuffer, decisions: int) -> None:
        parts = _parts(example)
        each = sum(part[0].nbytes for part in parts.values())
        self._size, self._filled = max(min(decisions, _BYTES // each), 1), 0
        self._kept = {name: np.empty((self._size, *part.shape[1:]), part.dtype) for name, part in parts.items()}

    def add(self, buffer: RolloutBuffer) -> None:
        """A rollout, in place of the oldest."""
        parts = _parts(buffer)
        count = len(parts["returns"])
        at = (self._filled + np.arange(count)) % self._size
        for name, part in parts.items():
            self._kept[name][at] = part
        self._filled += count

    def draw(self, count: int, rng: np.random.Generator) -> dict[str, torch.Tensor]:
        at = rng.integers(0, min(self._filled, self._size), count)
        return {name: torch.from_numpy(kept[at]) for name, kept in self._kept.items()}


def _parts(buffer: RolloutBuffer) -> dict[str, Array]:
    """Arrays of a rollout, (steps x environments, ...) each."""
    seen: Any = buffer.observations
    arrays = {f"seen.{name}": part for name, part in (seen if isinstance(seen, dict) else {"": seen}).items()}
    arrays |= {"actions": buffer.actions, "returns": buffer.returns}
    return {name: part.reshape(-1, *part.shape[2:]) for name, part in arrays.items()}


def warm_up(
    model: PPO,
    environments: VecEnv,
    rollouts: range,
    updates: int,
    seed: int,
    tell: Callable[[str], None],
    keep: Callable[[int], None],
) -> None:
    """Imitate over some rollouts of the model's size, with so many updates after each; its optimiser is left alone.

    rollouts: numbers of those to come, up to the last of all. The later, the lower the rate, and the more drives the
    policy. keep: called after each with how many there have been.
    """
    rng = np.random.default_rng(np.random.SeedSequence((seed, 1, rollouts.start)))
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=_RATE)
    seen, starts = environments.reset(), np.ones(environments.num_envs, dtype=bool)
    memory: ReplayMemory | None = None
    for rollout in rollouts:
        through = rollout / max(rollouts.stop - 1, 1)
        optimiser.param_groups[0]["lr"] = _RATE * (_LAST_RATE / _RATE) ** through
        # The first few environments are the policy's: all of them in the second half.
        own = np.arange(environments.num_envs) < 2.0 * through * environments.num_envs
        seen, starts = _drive(model, environments, seen, starts, own, rng)
        if memory is None:
            memory = ReplayMemory(model.rollout_buffer, len(rollouts) * model.n_steps * environments.num_envs)
        memory.add(model.rollout_buffer)
        wrong, missed = _learn(model, optimiser, memory, updates, rng)
        tell(f"imitation {rollout + 1}/{rollouts.stop}  action {wrong:.4f}  return {missed:.3f} (mean squares)")
        keep(rollout + 1)


def _drive(
    model: PPO, environments: VecEnv, seen: Any, starts: Any, own: npt.NDArray[np.bool_], rng: np.random.Generator
) -> Any:
    """Fill the model's buffer with what the teacher advises. own: (environments,) where the policy drives."""
    buffer = model.rollout_buffer
    buffer.reset()
    model.policy.set_training_mode(False)
    none = torch.zeros(environments.num_envs)
    for _ in range(model.n_steps):
        advised = np.stack(environments.env_method("advise"))
        wished, _ = model.predict(seen, deterministic=True)
        noise = rng.normal(0.0, _NOISE, advised.shape).astype(np.float32)
        driven = np.where(own[:, None], wished, advised) + noise
        after, earned, ends, _ = environments.step(np.clip(driven, -1.0, 1.0))
        buffer.add(seen, advised, earned, starts, _predict_values(model, seen), none)
        seen, starts = after, ends
    buffer.compute_returns_and_advantage(_predict_values(model, seen), starts)
    return seen, starts


def _predict_values(model: PPO, seen: Any) -> torch.Tensor:
    with torch.no_grad():
        return model.policy.predict_values(obs_as_tensor(seen, model.device))


def _learn(
    model: PPO, optimiser: torch.optim.Optimizer, memory: ReplayMemory, updates: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Mean squares over all updates: of the actions, and of the returns."""
    policy = model.policy
    policy.set_training_mode(True)
    sums = np.zeros(2)
    for _ in range(updates):
        part = {name: value.to(model.device) for name, value in memory.draw(model.batch_size, rng).items()}
        shown = {name.removeprefix("seen."): value for name, value in part.items() if name.startswith("seen.")}
        seen = shown.get("", shown)
        for_actor, for_critic = policy.mlp_extractor(policy.extract_features(seen))
        action = policy._get_action_dist_from_latent(for_actor).mode()
        wrong = mse_loss(action, part["actions"])
        missed = mse_loss(policy.value_net(for_critic).flatten(), part["returns"])
        optimiser.zero_grad()
        (wrong + model.vf_coef * missed).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
        optimiser.step()
        sums += (wrong.item(), missed.item())
    return float(sums[0] / updates), float(sums[1] / updates)
