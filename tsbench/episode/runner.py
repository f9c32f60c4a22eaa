"""Runs episodes one after the other with one planner, which is made once; a tick is `Episode.step`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from tsbench.core.errors import InputError
from tsbench.episode.episode import Episode, no_heartbeat
from tsbench.episode.outcome import EpisodeResult, Phase
from tsbench.episode.perception_level import EXACTLY, Perception
from tsbench.planners.base import Planner
from tsbench.planners.registry import LoadedPlanner
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation


class EpisodeRunner:
    """Runs episodes one after the other with one planner, made when the first begins.

    perception, heartbeat, simulation, loader: as `Episode` takes them. data: what scenes are of without a loader;
    None: the one in use.
    """

    def __init__(
        self,
        planner: LoadedPlanner,
        *,
        perception: Perception = EXACTLY,
        heartbeat: Callable[[int], None] = no_heartbeat,
        simulation: Simulation | None = None,
        loader: SceneLoader | None = None,
        data: DataSet | None = None,
    ) -> None:
        self._loaded, self._perception, self._beat = planner, perception, heartbeat
        self._planner: Planner | None = None
        self.simulation = Simulation() if simulation is None else simulation
        self._loader = SceneLoader(data or DataSet()) if loader is None else loader

    def prepare(self, spec: ScenarioSpec) -> None:
        """Make the planner and load the roads of a row, for children of this process to begin with.

        Raises whatever the planner's constructor does; roads that cannot be loaded are found in the episode.
        """
        self._make_planner()
        self._beat(Phase.LOADING)
        with suppress(InputError):
            _ = self._loader.load(spec)[1].view

    def run(self, spec: ScenarioSpec) -> EpisodeResult:
        """One episode; of what its code raises, only KeyboardInterrupt reaches the caller."""
        loaded = self._loaded
        episode = Episode(
            spec,
            planner=loaded.name,
            privileged=loaded.privileged,
            floor=loaded.floor,
            perception=self._perception,
            heartbeat=self._beat,
            simulation=self.simulation,
            loader=self._loader,
        )
        if episode.result is None:
            try:
                self._drive(episode)
            except KeyboardInterrupt:
                raise
            except BaseException as problem:
                episode.fail(problem)
        assert episode.result is not None
        return episode.result

    def _drive(self, episode: Episode) -> None:
        self._beat(Phase.PLANNING)
        planner = self._make_planner()
        planner.reset(episode.context)
        while episode.result is None:
            episode.step(planner.act(episode.observation))

    def _make_planner(self) -> Planner:
        if self._planner is None:
            self._planner = self._loaded.factory()
        return self._planner

    def close(self) -> None:
        self.simulation.close()
