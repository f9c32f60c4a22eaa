"""`carl`'s network: a small CNN on the raster, joined with measurements; Beta actions. About 2 M parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from tsbench.geometry.polyline import Array
from tsbench.learn.carl.raster import CHANNELS, MEASUREMENTS, PIXELS
from tsbench.planners.batching import Records, check_device
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
