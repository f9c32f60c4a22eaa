"""One expert on one scenario, tried until it obeys and arrives: what the oracle has the workers of `tsbench.run` do.

Source: docs/oracle.md, "select". Every try is driven with rounded commands, so that successes can be replayed.
"""

from __future__ import annotations

import zlib
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tsbench.core.text import one_line
from tsbench.core.typed import typed
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.oracle.trajectories import Commands, Intents, QuantisedPlanner, fingerprints, steps_of
from tsbench.metrics.comfort import comfort
from tsbench.metrics.episode_metrics import is_scd
from tsbench.metrics.tracks import tracks_of
from tsbench.planners.registry import LoadedPlanner
from tsbench.run.log.record import Record, Row
from tsbench.scenarios.spec import ScenarioSpec

# What is kept of a try; None where the drive broke off. steps: ticks; comfort: share; mean_speed: m/s.
FIGURES = ("compliant", "engaged", "steps", "comfort", "mean_speed", "ego", "others")


@dataclass(frozen=True)
class Attempt(EpisodeResult):
    """The last try of an expert on a scenario. tries: what is kept of each; intents: of the last."""

    tries: tuple[Row, ...]
    intents: Intents


class OracleRunner:
    """Drives a scenario again, each time with another driver, until it succeeds.

    most: tries at most. probe: a scenario (as a mapping) on which it is found out whether the expert draws its driver
    from the seed: one that does not would only repeat its drive. options: as `EpisodeRunner`'s.
    """

    def __init__(self, planner: LoadedPlanner, *, most: int, probe: Mapping[str, Any], **options: Any) -> None:
        self._quantised = QuantisedPlanner(planner.factory)
        self._runner = EpisodeRunner(replace(planner, factory=lambda: self._quantised), **options)
        self._most, self._probe = most, typed(ScenarioSpec, probe)
        self._draws: bool | None = None

    def prepare(self, spec: ScenarioSpec) -> None:
        """As `EpisodeRunner.prepare`."""
        self._runner.prepare(spec)

    def run(self, spec: ScenarioSpec) -> Attempt:
        """The episode, as often as it takes. Raises nothing for what a scene or planner does."""
        tries: list[Row] = []
        while True:
            result = self._drive(spec, len(tries))
            tries.append(try_of(result, len(tries)))
            if tries[-1]["scd"] or len(tries) == self._most or not self._draws_driver():
                return Attempt(**vars(result), tries=tuple(tries), intents=tuple(self._quantised.intents))

    def _drive(self, spec: ScenarioSpec, attempt: int) -> EpisodeResult:
        self._quantised.attempt = attempt
        return self._runner.run(spec)

    def _draws_driver(self) -> bool:
        if self._draws is None:
            kept = self._quantised.intents
            first, second = (self._drive(self._probe, attempt).commands for attempt in (0, 1))
            self._draws = not np.array_equal(first, second)
            self._quantised.intents = kept
        return self._draws

    def close(self) -> None:
        self._runner.close()


def try_of(result: EpisodeResult, attempt: int) -> Row:
    facts = None if result.outcome.is_error else result.facts
    row = {"attempt": attempt, "outcome": result.outcome.value, "error": one_line(result.error) or None}
    return {**row, "scd": False, **dict.fromkeys(FIGURES)} if facts is None else {**row, **_figures(facts)}


def lost_try(outcome: str, error: str | None) -> Row:
    """A drive that took its worker along."""
    row: Row = dict.fromkeys(FIGURES)
    return {"attempt": 0, "outcome": outcome, "error": error, "scd": False, **row}


def _figures(facts: EpisodeFacts) -> Row:
    tracks = tracks_of(facts.snapshots)
    ego, others = fingerprints(facts.snapshots)
    return {
        "scd": is_scd(facts),
        "compliant": facts.target.compliant,
        "engaged": facts.target.engaged,
        "steps": facts.snapshots[-1].step,
        "comfort": comfort(tracks),
        "mean_speed": float(tracks.speed.mean()),
        "ego": ego,
        "others": others,
    }


def record_of(result: Attempt, privileged: bool) -> Record:  # noqa: ARG001
    """What a worker sends back: all tries, and the commands of the one that succeeded."""
    last = result.tries[-1]
    row: Row = {
        "planner": result.planner,
        "scenario_id": result.spec.scenario_id,
        "outcome": last["outcome"],
        "error": last["error"],
        "scd": last["scd"],
        "tries": list(result.tries),
        "commands": pack(steps_of(result.commands)) if last["scd"] else None,
        "intents": [[tick, list(edges)] for tick, edges in result.intents] if last["scd"] else None,
    }
    return Record(row, [], {}, (result.detail or result.error) if result.outcome.is_error else "")


def pack(commands: Commands) -> str:
    """Commands as text, some two bytes a tick."""
    return b64encode(zlib.compress(commands.T.astype("<i2").tobytes(), 9)).decode()


def unpack(text: str) -> Commands:
    """(n, 2) commands of `pack`."""
    return np.frombuffer(zlib.decompress(b64decode(text)), dtype="<i2").reshape(2, -1).T.astype(np.int16)
