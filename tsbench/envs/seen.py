"""What an environment shows: the kinds of observation, each with its space and its encoder."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from tsbench.planners.base import Observation, PlannerContext
from tsbench.planners.ppo.vector import SIZE, VectorEncoder


class Seen(Protocol):
    """One kind of observation."""

    space: spaces.Space[Any]

    def reset(self, context: PlannerContext) -> None:
        """Start an episode."""

    def encode(self, observation: Observation) -> Any:
        """An element of `space`."""


class VectorSeen(VectorEncoder):
    """`vector`: the 275 numbers of `ppo`."""

    def __init__(self) -> None:
        super().__init__()
        self.space: spaces.Space[Any] = spaces.Box(-2.0, 2.0, (SIZE,), np.float32)


def _bev() -> Seen:
    # OpenCV is needed by none of the others.
    from tsbench.envs.bev import BevSeen

    return BevSeen()


def _objects() -> Seen:
    from tsbench.envs.objects import ObjectsSeen

    return ObjectsSeen()


KINDS: dict[str, Callable[[], Seen]] = {"vector": VectorSeen, "bev": _bev, "objects": _objects}
