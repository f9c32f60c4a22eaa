"""Drives to take frames from, driven again whenever they are asked for: deterministic simulation gives the same."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import asdict, dataclass
from typing import Any, Protocol, TypeVar, cast

from tsbench.episode.outcome import EpisodeFacts
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.plant2.tokens import Tokeniser
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import Roads, SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class DriveResult:
    """What a drive gave. since: first tick that may become a frame."""

    facts: EpisodeFacts
    roads: Roads
    since: int = 0


class EpisodeDrive(Protocol):
    """One episode and its driver; sent to the process that drives."""

    @property
    def spec(self) -> ScenarioSpec: ...

    @property
    def names(self) -> tuple[str, ...]:
        """What tells it from other drives: draws for its frames depend on them."""

    def facts(self) -> dict[str, Any]:
        """All that decides how it goes, for JSON."""

    def run(self, drivers: Drivers) -> DriveResult | None:
        """Drive; None where it gives no frames."""


class Drivers:
    """The simulation of a process, and all that is made once and used for many drives."""

    def __init__(self) -> None:
        self._loader, self._simulation = SceneLoader(DataSet.in_use()), Simulation()
        self._runners: dict[Hashable, object] = {}
        self._tokeniser: Tokeniser | None = None

    def drive(self, spec: ScenarioSpec, planner: str) -> DriveResult | None:
        """An episode by a planner that is named as for `tsbench run`; None where it ended in an error at once."""
        runner = self.kept(
            planner, lambda simulation, loader: EpisodeRunner(resolve(planner), simulation=simulation, loader=loader)
        )
        facts = runner.run(spec).facts
        return None if facts is None else DriveResult(facts, self.roads(spec))

    def kept(self, key: Hashable, make: Callable[[Simulation, SceneLoader], R]) -> R:
        """The runner of a key, always of one class; made in this process's simulation when first asked for."""
        if key not in self._runners:
            self._runners[key] = make(self._simulation, self._loader)
        return cast(R, self._runners[key])

    def roads(self, spec: ScenarioSpec) -> Roads:
        return self._loader.load(spec)[1]

    def tokeniser(self, roads: Roads, side_m: float) -> Tokeniser:
        """Of these roads, as far to the sides; the last one is kept."""
        kept = self._tokeniser
        if kept is None or kept.network is not roads.view.map or kept.side_m != side_m:
            kept = self._tokeniser = Tokeniser(roads.view.map, side_m)
        return kept

    def close(self) -> None:
        self._simulation.close()


@dataclass(frozen=True, slots=True)
class PlannerDrive:
    """A scenario driven by a planner."""

    spec: ScenarioSpec
    driver: str

    @property
    def names(self) -> tuple[str, ...]:
        return self.spec.scenario_id, self.driver

    def facts(self) -> dict[str, Any]:
        return asdict(self)

    def run(self, drivers: Drivers) -> DriveResult | None:
        """The whole episode, however it ends."""
        return drivers.drive(self.spec, self.driver)
