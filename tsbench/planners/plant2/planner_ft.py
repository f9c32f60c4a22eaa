"""`plant2-ft`: `plant2` that reads signs. Torch is imported when the planner is made, not before."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.batched import Infer
from tsbench.planners.plant2.layout import SIGN_TOKENS, Record, Records
from tsbench.planners.plant2.planner import Plant2
from tsbench.planners.plant2.signs import SignMemory, fill_signs
from tsbench.planners.plant2.tokens import Pose, Tokeniser


class SignTokeniser:
    """Tokens with signs, for one episode: it remembers the sign that holds."""

    def __init__(self, tokeniser: Tokeniser) -> None:
        self._tokeniser = tokeniser
        self._memory = SignMemory(tokeniser.network)

    def watch(self, o: Observation) -> None:
        """Remember the sign that holds: at every tick, in order; twice is as good as once."""
        self._memory.update(o)

    def fill(self, record: Record, o: Observation, pose: Pose | None = None) -> list[int]:
        """As `Tokeniser.fill`, into a record with the fields of `layout.SIGN_TOKENS`; after `watch`."""
        origins = self._tokeniser.fill(record, o, pose)
        here = (o.ego.x, o.ego.y, o.ego.heading) if pose is None else pose
        order = self._tokeniser.network.lanes[o.ego.lane].order if o.ego.lane >= 0 else 0
        fill_signs(record, o, here, order)
        record["sign_state"] = self._memory.state
        return origins


class Plant2Ft(Plant2):
    """The planner. Of earlier ticks it keeps the sign that holds."""

    sign_access = True
    weights: ClassVar[str] = "plant2-ft"
    inputs: ClassVar[np.dtype[Any]] = SIGN_TOKENS

    def __init__(self, infer: Infer | None = None, folder: Path | None = None) -> None:
        super().__init__(infer, folder)
        self._signs: SignTokeniser

    def reset(self, context: PlannerContext) -> None:
        """Start an episode: no sign holds."""
        super().reset(context)
        assert self._tokeniser is not None
        self._signs = SignTokeniser(self._tokeniser)

    def act(self, observation: Observation) -> Control:
        """One command for the next 0.1 s; the sign that holds is remembered at ticks without a plan too."""
        self._signs.watch(observation)
        return super().act(observation)

    def encode(self, observation: Observation) -> Records:
        """(1,) of the network's inputs; in order."""
        record: Records = np.zeros(1, dtype=SIGN_TOKENS)
        self._signs.watch(observation)
        self._signs.fill(record[0], observation)
        return record
