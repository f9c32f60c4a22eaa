"""`tsbench/Drive-v0`: scenarios as a Gymnasium environment, driven by the code of `tsbench run`.

libsumo holds one simulation per process, so one environment per process drives at a time: use AsyncVectorEnv or
Stable-Baselines3's SubprocVecEnv for several.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from tsbench.core.errors import InputError, SimulationError
from tsbench.envs.reward import RewardSpec, RouteReward
from tsbench.envs.seen import KINDS
from tsbench.envs.stepped_episode import Step, process_episode
from tsbench.episode.outcome import Outcome
from tsbench.episode.result import EpisodeResult
from tsbench.metrics.episode import passed
from tsbench.metrics.progress import route_completion
from tsbench.metrics.tracks import tracks_of
from tsbench.planners.base import Observation
from tsbench.planners.rl.actions import ACTIONS
from tsbench.run.plan import VARIANTS, choose_types, choose_variants
from tsbench.scenarios.store import check_files
from tsbench.scenarios.table import SPLITS, read_table, table_path
from tsbench.signs.catalog import load_catalog

# Times that a row of a type in `more` is in the draw.
_MORE = 3
# Not arriving in time is a failure with its price, and no arbitrary cut.
_ENDS = (Outcome.ARRIVED, Outcome.COLLISION, Outcome.OFF_ROAD, Outcome.TIMEOUT)


class DriveEnv(gymnasium.Env[Any, npt.NDArray[np.float32]]):
    """One scenario per episode, drawn from the table of a split.

    split: train | test. types: type ids and groups (a sequence, or words between commas), empty = all. observation:
    vector (275,) | bev (raster and measurements) | objects. action: aim (acceleration, place beside the route) |
    steer (acceleration, steering angle), both (2,) in -1..1. hold: ticks of 0.1 s per step. variants: as in `tsbench
    run`. mask_signs: remove sign identity (of `objects`). reward: figures of the reward. more: types and groups whose
    scenarios are drawn three times as often.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  (as Gymnasium declares it)

    def __init__(
        self,
        split: str = "train",
        types: str | Sequence[str] = (),
        observation: str = "vector",
        action: str = "aim",
        hold: int = 1,
        variants: str = "all",
        mask_signs: bool = False,
        reward: RewardSpec | None = None,
        more: str | Sequence[str] = (),
    ) -> None:
        _known("split", split, SPLITS)
        _known("observation", observation, KINDS)
        _known("action", action, ACTIONS)
        _known("variants", variants, VARIANTS)
        if hold < 1:
            raise InputError(f"hold {hold}: expected at least 1 tick")
        chosen = choose_types(_words(types), load_catalog())
        rows = [row for row in read_table(table_path(split)) if row.pair_type in chosen]
        self._rows = choose_variants(rows, variants)
        if not self._rows:
            raise InputError(f"{table_path(split)}: has no scenario of {', '.join(chosen)}")
        check_files(self._rows)
        self._by_id = {row.scenario_id: row for row in self._rows}
        if often := _words(more):
            kinds = choose_types(often, load_catalog())
            self._rows += (_MORE - 1) * [row for row in self._rows if row.pair_type in kinds]
        self._seen = KINDS[observation]()
        self._act = ACTIONS[action]
        self._hold, self._mask = hold, mask_signs
        self._reward_spec = RewardSpec() if reward is None else reward
        self._reward: RouteReward
        self._turn: Step | None = None
        self.observation_space = self._seen.space
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start `options["scenario_id"]`, or a scenario drawn from the environment's own generator."""
        super().reset(seed=seed)
        named = (options or {}).get("scenario_id")
        if named is not None and named not in self._by_id:
            raise InputError(f"scenario {named!r}: not among the {len(self._by_id)} of this environment")
        row = (
            self._rows[int(self.np_random.integers(len(self._rows)))] if named is None else self._by_id[named]
        )
        turn = process_episode().begin(row, self, self._mask)
        if isinstance(turn, EpisodeResult):
            raise SimulationError(f"{row.scenario_id}: {turn.error or turn.outcome}")
        self._seen.reset(turn.context)
        self._turn = turn
        self._reward = RouteReward(turn.observation, self._reward_spec)
        info = {"scenario_id": row.scenario_id, "scenario_type": row.scenario_type}
        return self._seen.encode(turn.observation), info

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """`hold` ticks with one action, or fewer up to the episode's end."""
        if self._turn is None or process_episode().driver is not self:
            raise gymnasium.error.ResetNeeded(
                "no episode: reset first (libsumo has one simulation per process, which another environment of this "
                "process may have taken; AsyncVectorEnv and SubprocVecEnv give each its own)"
            )
        first, second = (float(value) for value in action)
        if not (math.isfinite(first) and math.isfinite(second)):
            raise ValueError(f"action {first}, {second} is not finite")
        earned = 0.0
        for _ in range(self._hold):
            turn = process_episode().drive(self._act(first, second, self._turn.observation))
            if isinstance(turn, EpisodeResult):
                return self._over(turn, self._turn.observation, earned)
            self._turn = turn
            earned += self._reward.tick(turn.observation)
        return self._seen.encode(self._turn.observation), earned, False, False, {}

    @property
    def turn(self) -> Step:
        """What a planner would be shown now. Raises ResetNeeded between episodes."""
        if self._turn is None:
            raise gymnasium.error.ResetNeeded("no episode: reset first")
        return self._turn

    def _over(
        self, result: EpisodeResult, before: Observation, earned: float
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The end: a simulation that broke off counts as cut short, and says why in `info`."""
        self._turn = None
        last, info = before, {"outcome": str(result.outcome), "error": result.error}
        if result.facts is not None:
            last = process_episode().last_view()
            earned += self._reward.tick(last)
            info |= _verdict(result)
        ended = result.outcome in _ENDS
        return self._seen.encode(last), earned + self._reward.end(result.outcome), ended, not ended, info

    def close(self) -> None:
        """End the episode, and SUMO with it."""
        self._turn = None
        if process_episode().driver is self:
            process_episode().close()


def _words(asked: str | Sequence[str]) -> list[str]:
    words = asked.split(",") if isinstance(asked, str) else asked
    return [word.strip() for word in words if word.strip()]


def _known(name: str, value: str, known: Any) -> None:
    if value not in known:
        raise InputError(f"{name} {value!r}: expected {' | '.join(known)}")


def _verdict(result: EpisodeResult) -> dict[str, Any]:
    facts = result.facts
    assert facts is not None
    return {
        "sign_compliant": facts.target.compliant,
        "scd": passed(facts),
        "route_completion": route_completion(facts, tracks_of(facts.snapshots)),
        "at_fault": facts.contact is not None and facts.contact.at_fault,
    }
