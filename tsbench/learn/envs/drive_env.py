"""`tsbench/Drive-v1`: scenarios as a Gymnasium environment, driven by the code of `tsbench run`.

libsumo holds one simulation per process, so one environment per process drives at a time: use AsyncVectorEnv or
Stable-Baselines3's SubprocVecEnv for several. `Curriculum` says which scenarios it draws, and when.
"""

from __future__ import annotations

import math
import os
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv
from gymnasium.wrappers import TimeLimit

from tsbench.core.errors import InputError, SimulationError, load
from tsbench.core.paths import expanded_text
from tsbench.core.typed import typed
from tsbench.episode.episode import Episode, Judged
from tsbench.episode.outcome import EpisodeResult, Outcome
from tsbench.episode.perception_level import EXACT, Perception, load_level
from tsbench.learn.envs.reward import SIGNS, RewardSpec, RouteReward
from tsbench.learn.envs.seen_tables import KINDS
from tsbench.learn.rl.actions import EXIT, PLAIN, ExitAction
from tsbench.metrics.metric import route_completion
from tsbench.metrics.scd import is_scd
from tsbench.metrics.tracks import tracks_of
from tsbench.planners.base import Control
from tsbench.planners.observation import Observation
from tsbench.run.options import BOTH, VARIANTS, keywords, switch, text, type_words, whole_number
from tsbench.run.plan import choose_half, choose_types, choose_variants
from tsbench.scenarios.data_set import SPLITS, DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import check_files
from tsbench.sim.sumo import Simulation

if TYPE_CHECKING:
    from tsbench.learn.envs.view import View

# Times that a row of a type in `more` is in the draw.
_MORE = 3
# A callable gets the terms of a step by name, violations and needless obedience as minus their number.
Terms = Mapping[str, float]
Reward = Callable[[Terms], float]
_TERMS = ("progress", "violation", "needless", "end")
_OPTIONS = ("scenario_id", "scenario", "type", "half")
# Not arriving in time is a failure with its price, and no arbitrary cut.
_ENDS = (Outcome.ARRIVED, Outcome.COLLISION, Outcome.OFF_ROAD, Outcome.TIMEOUT)


def _shown_here(modes: Sequence[str]) -> list[str]:
    """The render modes that this machine has: `human` needs a screen, or another backend of Matplotlib's."""
    backend = os.environ.get("MPLBACKEND", "")
    window = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or backend
    return [mode for mode in modes if mode != "human" or (window and backend.lower() != "agg")]


class DriveEnv(gymnasium.Env[Any, npt.NDArray[np.float32]]):
    """One scenario per episode, drawn from the table of a split.

    split: train | dev | test. types: type ids and groups (a sequence, or words between commas), None = all.
    observation: vector (275,) | bev (raster and measurements) | objects | scene (plates and roads, scaled) | plates
    (scene without roads). action: aim (acceleration, place beside the route) | steer (acceleration, steering angle) |
    cruise (speed, place beside the route), all (2,) in -1..1 | exit (as aim, and the turn to take at the next
    junction, (3,)). hold: ticks of 0.1 s per step. variants: as in `tsbench run`. mask_signs: remove sign identity
    (of `objects`, `scene`, `plates`). reward: a RewardSpec, its fields as a mapping, or a callable that is given a
    step's terms. half: both | signed | contrast. more: types and groups whose scenarios are drawn three times as often.
    perception: a level's name or file, as in `tsbench run`. render_mode: rgb_array | human (a window) | None. city:
    another data set, as in `tsbench run`.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012  (as Gymnasium declares it)

    @keywords()
    def __init__(
        self,
        split: str = "train",
        types: str | Sequence[str] | None = None,
        observation: str = "vector",
        action: str = "aim",
        hold: int = 1,
        variants: str = "all",
        mask_signs: bool = False,
        reward: RewardSpec | Mapping[str, float] | Reward | None = None,
        more: str | Sequence[str] | None = None,
        half: str = BOTH,
        perception: str = EXACT,
        render_mode: str | None = None,
        city: str | None = None,
    ) -> None:
        if render_mode is not None:
            _known("render_mode", render_mode, self.metadata["render_modes"])
        self.metadata = {**self.metadata, "render_modes": _shown_here(self.metadata["render_modes"])}
        self.render_mode = render_mode
        _known("split", split, SPLITS)
        _known("observation", observation, KINDS)
        _known("action", action, (*PLAIN, EXIT))
        _known("variants", variants, VARIANTS)
        self._hold = whole_number("hold", hold, unit=" tick")
        masked = switch("mask_signs", mask_signs)
        if isinstance(reward, Mapping):
            # So Gymnasium writes a RewardSpec in an environment's JSON.
            try:
                reward = typed(RewardSpec, reward)
            except ValueError as problem:
                raise InputError(f"reward {reward!r}: {problem}") from problem
        if not (reward is None or isinstance(reward, RewardSpec) or callable(reward)):
            raise InputError(f"reward {reward!r}: expected a RewardSpec, or a function of a step's terms")
        self._data = data = DataSet.driven(None if city is None else text("city", city))
        chosen = choose_types(data.catalog, type_words("types", types))
        rows = [row for row in data.table(split) if row.pair_type in chosen]
        self._rows = choose_half(choose_variants(rows, variants), half)
        if not self._rows:
            raise InputError(f"{data.table_path(split)}: has no scenario of {', '.join(chosen)}")
        check_files(self._rows, data)
        self._by_id = {row.scenario_id: row for row in self._rows}
        if often := type_words("more", more or None):
            kinds = choose_types(data.catalog, often, "more")
            self._rows += (_MORE - 1) * [row for row in self._rows if row.pair_type in kinds]
        self._kind, self._action = observation, action
        self._make_encoders()
        self._perception = Perception(masked, load_level(expanded_text(str(perception))))
        self._view: View | None = None
        self._weigh: Reward | None = None
        if reward is None or isinstance(reward, RewardSpec):
            self._reward_spec = RewardSpec() if reward is None else reward
        else:
            self._reward_spec, self._weigh = SIGNS, reward
        self._reward: RouteReward
        self._episode: Episode | None = None
        self._last: Observation | None = None
        self.observation_space = self._seen.space
        actions: Any = spaces.Box(-1.0, 1.0, (3 if action == EXIT else 2,), np.float32)
        # Stable-Baselines3 writes it into a model's zip, where `planners from-sb3` finds it.
        actions.drive = {"observation": observation, "action": action, "hold": self._hold}
        self.action_space = actions

    def _make_encoders(self) -> None:
        """What turns observations and actions of one episode, and what loads it."""
        self._simulation = Simulation()
        self._loader = SceneLoader(self._data)
        self._seen = KINDS[self._kind]()
        self._act: Callable[..., Control] = ExitAction() if self._action == EXIT else PLAIN[self._action]

    def __getstate__(self) -> dict[str, Any]:
        """For `copy` and `pickle`: options and random generator, but no episode, as SUMO's cannot be copied."""
        own = ("_episode", "_last", "_view", "_simulation", "_loader", "_seen", "_act", "_reward")
        return self.__dict__ | dict.fromkeys(own)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._make_encoders()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start a scenario drawn from the environment's own generator.

        options: scenario (or scenario_id) names one; type (id or group) and half narrow the draw.
        """
        super().reset(seed=seed)
        rows = self._asked(options or {})
        row = rows[int(self.np_random.integers(len(rows)))] if len(rows) > 1 else rows[0]
        self._episode = None
        episode = Episode(row, perception=self._perception, simulation=self._simulation, loader=self._loader)
        if episode.result is not None:
            raise SimulationError(f"{row.scenario_id}: {episode.result.error or episode.result.outcome}")
        self._seen.reset(episode.context)
        if isinstance(self._act, ExitAction):
            self._act.reset(episode.context)
        self._episode, self._view, self._last = episode, None, episode.observation
        self._reward = RouteReward(self._last, self._reward_spec)
        self._counts = (0, 0)
        info = {"scenario_id": row.scenario_id, "scenario_type": row.scenario_type, "half": row.half}
        info |= _so_far(episode.judged())
        self._show()
        return self._seen.encode(self._last), info

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """`hold` ticks with one action, or fewer up to the episode's end."""
        episode = self._episode
        if episode is None or episode.result is not None or not episode.is_current:
            raise gymnasium.error.ResetNeeded(
                "no episode: reset first (libsumo has one simulation per process, which another environment of this "
                'process may have taken; make_vec(…, vectorization_mode="async"), '
                "AsyncVectorEnv and SubprocVecEnv give each its own)"
            )
        numbers = np.asarray(action, dtype=float).tolist()
        if np.shape(action) != self.action_space.shape:
            raise ValueError(f"action of shape {np.shape(action)}: expected one of {self.action_space}")
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"action {', '.join(map(str, numbers))} is not finite")
        earned = dict.fromkeys(_TERMS, 0.0)
        for _ in range(self._hold):
            episode.step(self._act(*numbers, episode.observation))
            if episode.result is not None:
                return self._over(episode, episode.result, earned)
            earned["progress"] += self._reward.tick(episode.observation)
        self._last = episode.observation
        self._show()
        reward, info = self._told(earned, episode.judged())
        return self._seen.encode(self._last), reward, False, False, info

    def render(self) -> Any:
        """(512, 512, 3) uint8 RGB with `rgb_array`; nothing with `human`, whose window follows by itself."""
        if self.render_mode is None or self._last is None:
            raise gymnasium.error.ResetNeeded("nothing to render: give render_mode, and reset first")
        return self._drawn().draw(self._last) if self.render_mode == "rgb_array" else None

    def _show(self) -> None:
        if self.render_mode == "human" and self._last is not None:
            self._drawn().show(self._last)

    def _drawn(self) -> View:
        """Made for the first picture: without pictures it costs nothing, nor needs the extra `report`."""
        if self._view is None:
            self._view = load("tsbench.learn.envs.view").View(self.episode.context)
        return self._view

    @keywords()
    def _asked(self, options: Mapping[str, Any]) -> list[ScenarioSpec]:
        """The rows that `reset`'s options leave to draw from."""
        for word in options:
            _known("option", word, _OPTIONS)
        named = options.get("scenario_id", options.get("scenario"))
        if named is not None:
            if named not in self._by_id:
                raise InputError(f"scenario {named!r}: not among the {len(self._by_id)} of this environment")
            return [self._by_id[named]]
        rows = choose_half(self._rows, options.get("half", BOTH))
        if "type" in options:
            kinds = choose_types(self._data.catalog, type_words("option type", options["type"]), "option type")
            rows = [row for row in rows if row.pair_type in kinds]
        if not rows:
            raise InputError(f"options {dict(options)}: this environment has no such scenario")
        return rows

    def _told(self, earned: dict[str, float], judged: Judged) -> tuple[float, dict[str, Any]]:
        """The step's reward, and what `info` says of it and of the episode so far."""
        counts = len(judged.violations), len(judged.needless)
        spec, before = self._reward_spec, self._counts
        earned["violation"] = spec.violation * (counts[0] - before[0])
        earned["needless"] = spec.needless * (counts[1] - before[1])
        self._counts = counts
        given = sum(earned.values()) if self._weigh is None else self._weigh(earned)
        try:
            reward = float(given)
        except (TypeError, ValueError):  # None, text, a vector
            reward = math.nan
        if not math.isfinite(reward):
            raise ValueError(f"reward {given!r} of {earned}: the function must return one finite number")
        return reward, {"reward_terms": earned, **_so_far(judged)}

    @property
    def episode(self) -> Episode:
        """The episode under way, or over. Raises ResetNeeded before the first."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("no episode: reset first")
        return self._episode

    def _over(
        self, episode: Episode, result: EpisodeResult, earned: dict[str, float]
    ) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The end: a simulation that broke off counts as cut short, and says why in `info`."""
        info: dict[str, Any] = {"outcome": str(result.outcome), "error": result.error}
        self._last = episode.observation
        if (facts := result.facts) is not None:
            self._last = episode.look()
            earned["progress"] += self._reward.tick(self._last)
            info |= {
                "sign_compliant": facts.verdicts.compliant,
                "scd": is_scd(facts),
                "route_completion": route_completion(facts, tracks_of(facts.snapshots)),
                "at_fault": facts.contact is not None and facts.contact.at_fault,
            }
        earned["end"] = self._reward.end(result.outcome)
        reward, told = self._told(earned, episode.judged())
        ended = result.outcome in _ENDS
        self._show()
        return self._seen.encode(self._last), reward, ended, not ended, info | told

    def close(self) -> None:
        """End the episode, and SUMO with it."""
        self._episode = None
        self._simulation.close()


def _so_far(judged: Judged) -> dict[str, Any]:
    return {"violations": judged.violations, "needless": judged.needless, "engaged": judged.engaged}


def _known(name: str, value: str, known: Any) -> None:
    if value not in known:
        raise InputError(f"{name} {value!r}: expected {' | '.join(known)}")


def drive_in_processes(num_envs: int = 1, max_episode_steps: int | None = None, **options: Any) -> AsyncVectorEnv:
    """libsumo has one simulation per process, so a vector of environments in one process could not drive."""
    return AsyncVectorEnv([partial(_one, max_episode_steps, options)] * num_envs, context="spawn")


def _one(steps: int | None, options: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    env = DriveEnv(**options)
    return env if steps is None else TimeLimit(env, steps)


class Curriculum(gymnasium.Wrapper[Any, Any, Any, Any]):
    """stages: (episodes, options of `reset`) in order; the last stage holds for good, whatever its number."""

    def __init__(self, env: gymnasium.Env[Any, Any], stages: Sequence[tuple[int, Mapping[str, Any]]]) -> None:
        super().__init__(env)
        if not stages or any(episodes < 1 for episodes, _ in stages):
            raise InputError("curriculum: expected at least one stage, each of at least one episode")
        self._ends = list(accumulate(episodes for episodes, _ in stages[:-1]))
        self._stages, self._begun = tuple(options for _, options in stages), 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """As the environment's; what is asked for here goes before what the stage asks for."""
        stage = self._stages[bisect_right(self._ends, self._begun)]
        self._begun += 1
        return self.env.reset(seed=seed, options={**stage, **(options or {})})
