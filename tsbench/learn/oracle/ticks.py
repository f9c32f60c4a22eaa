"""The oracle's drives as ticks: each is driven again from its commands.

Numbers are those of the environment's `scene` observation (scaled, in the ego's frame), flattened. Units: s; action in
m/s2 and rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsbench.core.errors import SimulationError
from tsbench.envs.reward import RewardSpec, RouteReward
from tsbench.envs.scene_seen import SceneSeen
from tsbench.episode.outcome import EpisodeResult
from tsbench.learn.oracle.trajectories import Recorded, Replay, difference
from tsbench.run.stepped_episode import Judged, Step, process_episode
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


def driven(index: int, drive: Recorded, row: ScenarioSpec, seen: SceneSeen) -> Driven:
    """A drive, driven again. Raises SimulationError as a replay does."""
    facts = {
        "scenario_id": row.scenario_id,
        "planner": drive.planner,
        "part": drive.part,
        "type": row.scenario_type,
        "sign": row.sign_code,
        "half": row.half,
    }
    return Driven(index, facts, list(_ticks(drive, row, seen)))


def _ticks(drive: Recorded, row: ScenarioSpec, seen: SceneSeen) -> Iterator[dict[str, Any]]:
    """A drive's ticks: what is seen, the command, and what it earns. Raises SimulationError as a replay does."""
    replay = Replay(drive)
    turn = process_episode().begin(row, drive)
    if isinstance(turn, EpisodeResult):
        raise SimulationError(f"{row.scenario_id}: {turn.error or turn.outcome}")
    replay.reset(turn.context)
    seen.reset(turn.context)
    reward, before = RouteReward(turn.observation, RewardSpec()), process_episode().judged()
    while isinstance(turn, Step):
        o, encoded = turn.observation, seen.encode(turn.observation)
        control = replay.act(o)
        tick = {f"observation.{name}": encoded[key].ravel() for name, key in SEEN.items()}
        tick |= {"frame_index": o.step, "timestamp": o.time}
        tick["action"] = np.array((control.acceleration, control.steering), dtype=np.float32)
        turn = process_episode().drive(control)
        after, last = _after(turn)
        tick["reward.progress"] = reward.tick(process_episode().last_view())
        tick["reward.violation"] = float(len(before.violations) - len(after.violations))
        tick["reward.needless"] = float(len(before.needless) - len(after.needless))
        tick["reward.end"] = reward.end(last.outcome) if last else 0.0
        tick["done"] = last is not None
        before = after
        yield tick
    differs = difference(drive, row, turn.facts, turn.error)
    if differs:
        raise SimulationError(f"{row.scenario_id}: {drive.planner}: the replay differs: {differs}")


def _after(turn: Step | EpisodeResult) -> tuple[Judged, EpisodeResult | None]:
    if isinstance(turn, Step):
        return process_episode().judged(), None
    if turn.facts is None:
        raise SimulationError(f"{turn.spec.scenario_id}: {turn.error or turn.outcome}")
    return Judged.of(turn.facts), turn
