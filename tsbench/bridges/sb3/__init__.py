"""Policies of Stable-Baselines3 that were trained in tsbench's environment, as planners. Nothing is unpickled.

Around a policy's network: the environment's observation and action.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp
from tsbench.learn.envs.seen_tables import KINDS
from tsbench.learn.fixed_point import BITS, LARGEST, Linear, Parameters, rectified, snap, tanh
from tsbench.learn.rl.actions import EXIT, PLAIN, ExitAction, normal_quantile
from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.observation import Observation
from tsbench.planners.weights import Tensors, fitted, network

# Of the two files beside the planner's own.
WEIGHTS = "policy"
# Observations are about -1..1; what is beyond is cut, which bounds all that follows.
_MOST = 2.0
# More decisions than an episode has.
_DECISIONS = 1024
TANH, RELU = "tanh", "relu"
# Observations whose numbers are scaled, and those of them that show plates.
SCALED = ("vector", "plates", "scene")
READING = ("plates", "scene")

Array = npt.NDArray[np.float64]
Mlp = Callable[[Array], Array]


class Sb3Planner:
    """A policy in a folder: its class says which, and what it sees.

    folder: of `policy.json` and `policy.safetensors`, as `tsbench planners from-sb3` writes them.
    """

    privileged = False
    folder: ClassVar[Path]

    def __init__(self) -> None:
        facts = network(WEIGHTS, self.folder).training
        self._seen = KINDS[facts["observation"]]()
        self._exit = ExitAction() if facts["action"] == EXIT else None
        self._hold, self._draws = int(facts["hold"]), bool(facts["draws"])
        self._axis = int(facts.get("frames_axis", -1))
        self._kept: deque[Mapping[str, Any]] = deque(maxlen=int(facts.get("frames", 1)))
        self._plain = PLAIN.get(facts["action"])
        self._answer, self._width = _loaded(self.folder)
        self._action: tuple[float, ...] = ()
        self._quantiles: Array

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; draws come from its seed."""
        self._seen.reset(context)
        self._kept.clear()
        if self._exit is not None:
            self._exit.reset(context)
        rng = np.random.default_rng(np.random.SeedSequence(context.seed))
        self._quantiles = rng.random((_DECISIONS, len(self._width)))

    def act(self, observation: Observation) -> Control:
        """A decision each `hold` ticks; what it means for the vehicle is worked out at every tick."""
        if observation.step % self._hold == 0:
            self._action = tuple(self._decide(observation).tolist())
        if self._exit is not None:
            first, second, third = self._action
            return self._exit(first, second, third, observation)
        assert self._plain is not None
        return self._plain(self._action[0], self._action[1], observation)

    def _decide(self, observation: Observation) -> Array:
        mean = self._answer(self._stacked(self._seen.encode(observation))[None])[0]
        if self._draws:
            mean += self._width * normal_quantile(self._quantiles[observation.step // self._hold % _DECISIONS])
        clipped: Array = np.clip(mean, -1.0, 1.0)
        return clipped

    def _stacked(self, seen: Any) -> Array:
        """The last observations as the network sees them, oldest first.

        Before the first stand zeros, as in Stable-Baselines3's VecFrameStack (the last axis), or the first itself, as
        in Gymnasium's FrameStackObservation (a new axis).
        """
        parts = seen if isinstance(seen, Mapping) else {"": seen}
        if not self._kept:
            before = {name: np.zeros_like(values) for name, values in parts.items()} if self._axis else parts
            self._kept.extend([before] * int(self._kept.maxlen or 1))
        self._kept.append(parts)
        join: Any = np.concatenate if self._axis else np.stack
        rows = [join([kept[name] for kept in self._kept], axis=self._axis).ravel() for name in sorted(parts)]
        return np.concatenate(rows, dtype=np.float64)


@cache
def _loaded(folder: Path) -> tuple[Mlp, Array]:
    """The network below `folder`, and the standard deviations of what it answers."""
    facts = network(WEIGHTS, folder).training
    return fitted(WEIGHTS, folder, lambda tensors: mlp(tensors, facts))


def mlp(tensors: Tensors, facts: Any) -> tuple[Mlp, Array]:
    """(b, inputs) to (b, actions), in fixed-point numbers, and (actions,) standard deviations.

    Tensors: hidden.K.weight and .bias, action.weight and .bias, action.log_std. facts: activation (tanh | relu) and
    squashed, whether a tanh follows. Raises KeyError and ValueError for what does not fit.
    """
    of, layers, bound = Parameters(tensors), [], _MOST
    relu = facts["activation"] == RELU
    for k in range(sum(name.startswith("hidden.") for name in tensors) // 2):
        layers.append(Linear(*of.linear(f"hidden.{k}"), bound=bound, snapped=BITS if relu else None))
        bound = LARGEST if relu else 1.0
    last = Linear(*of.linear("action"), bound=bound, snapped=None)
    width = exp(of.take("action.log_std").astype(np.float64))
    of.end()
    bend = rectified if relu else tanh

    def answer(x: Array) -> Array:
        x = snap(np.clip(x, -_MOST, _MOST))
        for layer in layers:
            x = bend(layer(x))
        y = last(x)
        return tanh(y) if facts["squashed"] else y

    return answer, width
