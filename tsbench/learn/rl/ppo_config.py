"""What a reinforcement-learning run is made of: the asked options, and the figures of each planner's PPO."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

from tsbench.learn.envs.reward import RewardSpec
from tsbench.learn.rl.actions import HOLD_TICKS


@dataclass(frozen=True, slots=True)
class Hyper:
    """Of PPO (Schulman et al., arXiv 1707.06347), in Stable-Baselines3's terms; a step is one decision.

    rollout: steps of all environments between updates. rate: of Adam, falling to a tenth over the run. threads: of
    torch: more wait for each other as soon as anything else runs, and the driving processes do. imitation, updates:
    rollouts of `dagger` before all that, if not asked for otherwise, and updates after each. gamma: so near to 1 that
    what standing still costs at the end of an episode counts.
    """

    observation: str
    rollout: int
    batch: int
    epochs: int
    rate: float
    threads: int
    imitation: int
    updates: int
    gamma: float = 0.999
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.002
    value: float = 0.5
    gradient: float = 0.5


HYPER: Mapping[str, Hyper] = MappingProxyType(
    {
        "ppo": Hyper("vector", rollout=4096, batch=256, epochs=8, rate=3e-4, threads=1, imitation=40, updates=400),
        "carl": Hyper("bev", rollout=2048, batch=256, epochs=3, rate=2.5e-4, threads=1, imitation=40, updates=60),
    }
)


@dataclass(frozen=True, slots=True)
class Job:
    """One training as asked for. steps: decisions of `HOLD_TICKS` ticks in all. types: as of `tsbench run`.

    imitation: rollouts of `rl.dagger` in all, None = the planner's; asked for later, they go before further steps.
    rate: of Adam at the start of this session, None = the planner's. more: types and groups drawn three times as often.
    """

    planner: str
    out: Path
    steps: int
    workers: int
    seed: int
    device: str
    types: tuple[str, ...]
    imitation: int | None = None
    rate: float | None = None
    more: tuple[str, ...] = ()

    def facts(self) -> dict[str, object]:
        """What a training that is continued must have in common with the one before."""
        return {
            "planner": self.planner,
            "seed": self.seed,
            "split": "train",
            "hold_ticks": HOLD_TICKS,
            "reward": asdict(RewardSpec()),
        }
