"""The oracle's drives as ticks: each is driven again from its commands.

Numbers are those of the environment's `scene` observation (scaled, in the ego's frame), flattened. Units: s; action in
m/s2 and rad.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsbench.core.errors import SimulationError
from tsbench.episode.episode import Episode
from tsbench.learn.envs.reward import RewardSpec, RouteReward
from tsbench.learn.envs.scene_seen import SceneSeen
from tsbench.learn.oracle.trajectories import Recorded, Replay, difference
from tsbench.scenarios.spec import ScenarioSpec

# The tables of `scene`, by the name that follows `observation.`.
_TABLES = [f"{name}{mask}" for name in ("plates", "lanes", "actors", "obstacles") for mask in ("", "_mask")]
SEEN = {"state": "ego", "route": "route", **{name: name for name in _TABLES}}
REWARDS = ("progress", "violation", "needless", "end")


@dataclass(frozen=True)
class Driven:
    """A drive's facts (text: scenario_id, planner, part, type, sign, half; and its number) and its ticks."""

    index: int
    facts: Mapping[str, str]
    ticks: list[dict[str, Any]]


def shapes(seen: SceneSeen) -> dict[str, tuple[int, ...]]:
    """Of what is flattened, by column."""
    return {f"observation.{name}": seen.space[key].shape for name, key in SEEN.items()}  # type: ignore[index]


def driven(
    index: int, drive: Recorded, row: ScenarioSpec, seen: SceneSeen, begin: Callable[[ScenarioSpec], Episode]
) -> Driven:
    """A drive, driven again. begin: makes the episode of a row. Raises SimulationError as a replay does."""
    facts = {
        "scenario_id": row.scenario_id,
        "planner": drive.planner,
        "part": drive.part,
        "type": row.scenario_type,
        "sign": row.sign_code,
        "half": row.half,
    }
    return Driven(index, facts, list(_ticks(drive, row, seen, begin)))


def _ticks(
    drive: Recorded, row: ScenarioSpec, seen: SceneSeen, begin: Callable[[ScenarioSpec], Episode]
) -> Iterator[dict[str, Any]]:
    """A drive's ticks: what is seen, the command, and what it earns. Raises SimulationError as a replay does."""
    replay = Replay(drive)
    episode = begin(row)
    if episode.result is not None:
        raise SimulationError(f"{row.scenario_id}: {episode.result.error or episode.result.outcome}")
    replay.reset(episode.context)
    seen.reset(episode.context)
    reward, before = RouteReward(episode.observation, RewardSpec()), episode.judged()
    while episode.result is None:
        o = episode.observation
        encoded, control = seen.encode(o), replay.act(o)
        tick = {f"observation.{name}": encoded[key].ravel() for name, key in SEEN.items()}
        tick |= {"frame_index": o.step, "timestamp": o.time}
        tick["action"] = np.array((control.acceleration, control.steering), dtype=np.float32)
        episode.step(control)
        after, last = episode.judged(), episode.result
        if last is not None and last.facts is None:
            raise SimulationError(f"{row.scenario_id}: {last.error or last.outcome}")
        tick["reward.progress"] = reward.tick(episode.look())
        tick["reward.violation"] = float(len(before.violations) - len(after.violations))
        tick["reward.needless"] = float(len(before.needless) - len(after.needless))
        tick["reward.end"] = reward.end(last.outcome) if last else 0.0
        tick["done"] = last is not None
        before = after
        yield tick
    differs = difference(drive, row, episode.result.facts, episode.result.error)
    if differs:
        raise SimulationError(f"{row.scenario_id}: {drive.planner}: the replay differs: {differs}")
