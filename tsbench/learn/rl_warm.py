"""How a training begins: the policy imitates a teacher, and the critic learns what that earns.

What this spares are the hours in which a fresh policy finds out that one stops behind a leader; PPO goes on from there.
The teacher says in each state what it would do; who drives is the teacher at first and more and more the policy, whose
own mistakes are then what it is taught on (DAgger, Ross et al., arXiv 1011.0686). Noise is added to what is driven and
not to what is learned.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import gymnasium
import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import mse_loss

from tsbench.envs.drive import DriveEnv
from tsbench.learn.teacher import Teacher
from tsbench.planners.learned_actions import action_for

_NOISE = 0.25
_EPOCHS = 4
_RATE, _LAST_RATE = 1e-3, 1e-4


class Taught(gymnasium.Wrapper[Any, npt.NDArray[np.float32], Any, npt.NDArray[np.float32]]):
    """A driving environment that also says what the teacher would do."""

    def __init__(self, env: gymnasium.Env[Any, npt.NDArray[np.float32]]) -> None:
        super().__init__(env)
        self._teacher = Teacher()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        found = self.env.reset(seed=seed, options=options)
        self._teacher.reset(self._drive.turn.context)
        return found

    def advise(self) -> npt.NDArray[np.float32]:
        """(2,) the action that comes closest to what the teacher does now; once per step."""
        return np.array(action_for(*self._teacher.advise(self._drive.turn.observation)), dtype=np.float32)

    @property
    def _drive(self) -> DriveEnv:
        return cast("DriveEnv", self.env.unwrapped)


def warm_up(model: PPO, environments: VecEnv, rollouts: int, seed: int, tell: Callable[[str], None]) -> None:
    """Imitate over some rollouts of the model's size; its optimiser stays fresh."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, 1)))
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=_RATE)
    seen, starts = environments.reset(), np.ones(environments.num_envs, dtype=bool)
    for rollout in range(rollouts):
        through = rollout / max(rollouts - 1, 1)
        optimiser.param_groups[0]["lr"] = _RATE * (_LAST_RATE / _RATE) ** through
        # The first few environments are the policy's: all of them in the second half.
        own = np.arange(environments.num_envs) < 2.0 * through * environments.num_envs
        seen, starts = _drive(model, environments, seen, starts, own, rng)
        wrong, missed = _learn(model, optimiser)
        tell(f"imitation {rollout + 1}/{rollouts}  action {wrong:.4f}  return {missed:.3f} (mean squares)")


def _drive(
    model: PPO,
    environments: VecEnv,
    seen: Any,
    starts: Any,
    own: npt.NDArray[np.bool_],
    rng: np.random.Generator,
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
        buffer.add(seen, advised, earned, starts, _worth(model, seen), none)
        seen, starts = after, ends
    buffer.compute_returns_and_advantage(_worth(model, seen), starts)
    return seen, starts


def _worth(model: PPO, seen: Any) -> torch.Tensor:
    with torch.no_grad():
        return model.policy.predict_values(obs_as_tensor(seen, model.device))


def _learn(model: PPO, optimiser: torch.optim.Optimizer) -> tuple[float, float]:
    """Some passes over the buffer; mean squares of the last one: of the actions, and of the returns."""
    policy = model.policy
    policy.set_training_mode(True)
    sums, count = np.zeros(2), 0
    for epoch in range(_EPOCHS):
        for part in model.rollout_buffer.get(model.batch_size):
            for_actor, for_critic = policy.mlp_extractor(policy.extract_features(part.observations))
            action = policy._get_action_dist_from_latent(for_actor).mode()
            wrong = mse_loss(action, part.actions)
            missed = mse_loss(policy.value_net(for_critic).flatten(), part.returns)
            optimiser.zero_grad()
            (wrong + model.vf_coef * missed).backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
            optimiser.step()
            if epoch == _EPOCHS - 1:
                sums += (wrong.item(), missed.item())
                count += 1
    return float(sums[0] / count), float(sums[1] / count)
