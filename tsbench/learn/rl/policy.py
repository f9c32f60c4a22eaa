"""The networks of `ppo` and `carl` as Stable-Baselines3 trains them, and how their actors are taken out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import PyTorchObs
from torch import nn
from torch.nn.functional import softplus

from tsbench.geometry.polyline import Array
from tsbench.learn.shared_inputs import CHANNELS, MEASUREMENTS, PIXELS
from tsbench.planners.base import Records, check_device
from tsbench.planners.weights import Tensors

LATENT = 256
_WIDE = 768
_MEASURED = 64


class CarlTrunk(nn.Module):
    """Raster (n, 9, 128, 128) in 0..255 and measurements (n, 10) to (n, LATENT)."""

    def __init__(self) -> None:
        super().__init__()
        self.image = nn.Sequential(
            nn.Conv2d(CHANNELS, 16, 8, stride=4),
            nn.ReLU(),
            nn.Conv2d(16, 32, 4, stride=2),
            nn.ReLU(),
            nn.Conv2d(32, 64, 3, stride=2),
            nn.ReLU(),
            nn.Flatten(),
        )
        # Channels last: on a CPU the convolutions then take a third of the time.
        self.image = self.image.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        with torch.no_grad():
            size = int(self.image(torch.zeros(1, CHANNELS, PIXELS, PIXELS)).shape[1])
        self.wide = nn.Sequential(nn.Linear(size, _WIDE), nn.ReLU())
        self.measured = nn.Sequential(nn.Linear(MEASUREMENTS, _MEASURED), nn.ReLU())
        self.joint = nn.Sequential(nn.Linear(_WIDE + _MEASURED, LATENT), nn.ReLU())

    def forward(self, raster: torch.Tensor, measurements: torch.Tensor) -> torch.Tensor:
        shades = raster.to(torch.float32, memory_format=torch.channels_last) / 255.0
        seen = self.wide(self.image(shades))
        latent: torch.Tensor = self.joint(torch.cat((seen, self.measured(measurements)), dim=1))
        return latent


class CarlActor(nn.Module):
    """The actor alone: the Beta densities of its two actions."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = CarlTrunk()
        self.action = nn.Linear(LATENT, 4)

    def forward(self, raster: torch.Tensor, measurements: torch.Tensor) -> torch.Tensor:
        """(n, 2, 2) both parameters, each above 1, of each action's density, which lies over -1..1."""
        raw: torch.Tensor = 1.0 + nn.functional.softplus(self.action(self.trunk(raster, measurements)))
        return raw.reshape(-1, 2, 2)


def densities_by_torch(weights: Tensors, device: str) -> Callable[[Records], Array]:
    """As `CarlEngine`, on a device; raises InputError where torch does not see it, RuntimeError for other weights."""
    check_device(device)
    net = CarlActor()
    net.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
    net = net.to(device).eval()

    def densities(records: Records) -> Array:
        found = []
        with torch.inference_mode():
            # One at a time: convolutions of several rows round differently.
            for k in range(len(records)):
                seen = (np.array(records[name][k : k + 1]) for name in ("bev", "measurements"))
                found.append(net(*(torch.from_numpy(x).to(device) for x in seen)).double().cpu().numpy())
        return np.concatenate(found)

    return densities


# Beta densities with both parameters above 1 have their mode inside.
_LEAST = 1.0
_NARROW = 6.0


class BetaActions(Distribution):
    """Independent Beta densities, stretched from 0..1 to -1..1."""

    def __init__(self, size: int) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._size = size
        self._beta: torch.distributions.Beta

    def proba_distribution_net(self, latent_dim: int) -> nn.Module:
        return nn.Linear(latent_dim, 2 * self._size)

    def proba_distribution(self, raw: torch.Tensor) -> BetaActions:
        a, b = (_LEAST + softplus(raw)).chunk(2, dim=-1)
        self._beta = torch.distributions.Beta(a, b)
        return self

    def log_prob(self, x: torch.Tensor) -> torch.Tensor:
        """Log density of actions in -1..1; the ends themselves have none, so a hair is kept from them."""
        unit = (0.5 * (x + 1.0)).clamp(1e-5, 1.0 - 1e-5)
        logs: torch.Tensor = self._beta.log_prob(unit)  # type: ignore[no-untyped-call]
        return logs.sum(dim=-1) - self._size * float(np.log(2.0))

    def entropy(self) -> torch.Tensor:
        entropy: torch.Tensor = self._beta.entropy()  # type: ignore[no-untyped-call]
        return entropy.sum(dim=-1) + self._size * float(np.log(2.0))

    def sample(self) -> torch.Tensor:
        drawn: torch.Tensor = self._beta.rsample()
        return 2.0 * drawn - 1.0

    def mode(self) -> torch.Tensor:
        a, b = self._beta.concentration1, self._beta.concentration0
        mode: torch.Tensor = 2.0 * (a - 1.0) / (a + b - 2.0).clamp(min=1e-6) - 1.0
        return mode

    def actions_from_params(self, raw: torch.Tensor, deterministic: bool = False) -> torch.Tensor:
        return self.proba_distribution(raw).get_actions(deterministic=deterministic)

    def log_prob_from_params(self, raw: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        actions = self.actions_from_params(raw)
        return actions, self.log_prob(actions)


class CarlFeatures(BaseFeaturesExtractor):
    """`carl`'s trunk."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        super().__init__(observation_space, features_dim=LATENT)
        self.trunk = CarlTrunk()

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        latent: torch.Tensor = self.trunk(observations["bev"], observations["measurements"])
        return latent


class BetaPolicy(ActorCriticPolicy):
    """Actor and critic as linear heads on a shared trunk, with Beta actions."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        # The trunk scales: not every way through Stable-Baselines3 comes by `extract_features`.
        kwargs |= {"net_arch": [], "normalize_images": False}
        super().__init__(*args, **kwargs)

    def extract_features(
        self, obs: PyTorchObs, features_extractor: BaseFeaturesExtractor | None = None
    ) -> torch.Tensor:
        """Features of observations as they are: the trunk scales the raster, and bytes are moved, not floats."""
        extract = self.features_extractor if features_extractor is None else features_extractor
        return cast(torch.Tensor, extract(obs))

    def _build(self, lr_schedule: Any) -> None:
        size = int(np.prod(self.action_space.shape or (1,)))
        self.action_dist = BetaActions(size)
        self._build_mlp_extractor()
        latent = self.mlp_extractor.latent_dim_pi
        actor, critic = nn.Linear(latent, 2 * size), nn.Linear(self.mlp_extractor.latent_dim_vf, 1)
        for layer, gain in ((actor, 0.01), (critic, 1.0)):
            nn.init.orthogonal_(layer.weight, gain)
            nn.init.zeros_(layer.bias)
        # Begins with densities as narrow as those of `ppo`: nearly flat ones swerve into everything.
        nn.init.constant_(actor.bias, _NARROW)
        self.action_net, self.value_net = actor, critic
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), eps=1e-5)

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> Distribution:
        assert isinstance(self.action_dist, BetaActions)
        return self.action_dist.proba_distribution(self.action_net(latent_pi))


def policy_of(planner: str) -> tuple[type[ActorCriticPolicy], dict[str, Any]]:
    if planner == "ppo":
        return ActorCriticPolicy, {
            "net_arch": {"pi": [256, 256], "vf": [256, 256]},
            "activation_fn": nn.Tanh,
            "log_std_init": -1.4,
        }
    return BetaPolicy, {"features_extractor_class": CarlFeatures}


def actor_tensors(planner: str, policy: ActorCriticPolicy) -> Tensors:
    """The actor's tensors under the names that the planner loads."""
    state = policy.state_dict()
    if planner == "ppo":
        names = {f"mlp_extractor.policy_net.{2 * k}": f"hidden.{k}" for k in range(2)} | {"action_net": "action"}
    else:
        names = {"features_extractor.trunk": "trunk", "action_net": "action"}
    tensors = {
        new + key.removeprefix(old): value.detach().cpu().numpy()
        for old, new in names.items()
        for key, value in state.items()
        if key.startswith(f"{old}.")
    }
    if planner == "ppo":
        tensors["action.log_std"] = state["log_std"].detach().cpu().numpy()
    return tensors
