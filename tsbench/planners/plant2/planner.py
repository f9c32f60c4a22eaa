"""`plant2`, blind to signs. Torch is imported when the planner is made, not before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tsbench.maps.network import RoadNetwork
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.expert import Expert
from tsbench.planners.plant2.control import Gains, control
from tsbench.planners.plant2.layout import Records
from tsbench.planners.plant2.tokens import Tokeniser

if TYPE_CHECKING:
    from tsbench.planners.plant2.inference import Inference

WEIGHTS = "plant2"


class Plant2:
    """The planner. An observation gives the command; nothing of earlier ticks is kept."""

    privileged = False
    sign_access = False

    def __init__(self, inference: Inference | None = None, folder: Path | None = None) -> None:
        """`folder`: of the weights, None for those that come with tsbench."""
        if inference is None:
            from tsbench.planners.plant2.inference import Inference

            inference = Inference.from_weights(WEIGHTS, folder)
        self._inference = inference
        self._gains = Gains()
        self._tokeniser: Tokeniser | None = None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; what is drawn of a network is kept for the next episode on it."""
        self._tokeniser = _tokeniser_for(context.network, self._tokeniser)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s."""
        return self.act_batch([observation])[0]

    def act_batch(self, observations: Sequence[Observation]) -> list[Control]:
        """Commands for several observations in one network of roads; each as it would be alone, to the bit."""
        return self.decide(observations, np.concatenate([self.encode(o) for o in observations]))

    def encode(self, observation: Observation) -> Records:
        """(1,) of the network's inputs: all that an inference process needs to be sent."""
        assert self._tokeniser is not None, "act before reset"
        return self._tokeniser.tokens(observation)

    def decide(self, observations: Sequence[Observation], tokens: Records) -> list[Control]:
        """Commands from (b,) inputs, of whatever episodes."""
        plans = self._inference.plans(tokens)
        return [
            control(p.path, p.speed, o.ego, self._gains) for p, o in zip(plans, observations, strict=True)
        ]


class Plant2Expert(Expert):
    """`plant2-e`."""

    def __init__(self) -> None:
        super().__init__(Plant2())


def _tokeniser_for(network: RoadNetwork, last: Tokeniser | None) -> Tokeniser:
    return last if last is not None and last.network is network else Tokeniser(network)
