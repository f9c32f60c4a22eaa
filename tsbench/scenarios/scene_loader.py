"""From a scenario row to a loaded scene, with the parsed network kept for the rows that share it."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property

from tsbench.core.errors import InputError
from tsbench.core.xmlfile import sha256
from tsbench.roads.lane_graph import LaneGraph
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.roads.planner_map import PlannerMap, build_planner_map
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.mirror import mirrored_additional, mirrored_network
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneFiles, SceneStore
from tsbench.sim.scene import Scene, SceneFile, SceneLayout
from tsbench.sim.scene_file import read_layout

_KEPT_NETWORKS = 4


@dataclass(frozen=True)
class Roads:
    """A network with what is derived from it once, and the file that it was read from."""

    network: RoadNetwork
    graph: LaneGraph
    locator: LaneLocator
    file: SceneFile

    @cached_property
    def view(self) -> PlannerMap:
        """What planners see of it."""
        return build_planner_map(self.network)


class SceneLoader:
    """Loads the scenes of a data set, checking each file against its row.

    Those of a mirrored one are made of the stored ones, once these are checked. files: where else they are.
    """

    def __init__(self, data: DataSet, files: SceneFiles | None = None) -> None:
        self.files = SceneStore(data) if files is None else files
        self.catalog, self._city = data.catalog, data.city
        self._roads: OrderedDict[str, Roads] = OrderedDict()

    def load(self, spec: ScenarioSpec) -> tuple[Scene, Roads]:
        """The scene of a row. Raises InputError for a missing, changed or malformed file."""
        additional, layout = self.layout(spec)
        roads = self._load_roads(spec)
        return Scene(
            **vars(layout),
            catalog=self.catalog,
            net=roads.file,
            additional=additional,
            network=roads.network,
            horizon=spec.horizon,
            seed=spec.seed,
            city=self._city,
        ), roads

    def layout(self, spec: ScenarioSpec) -> tuple[SceneFile, SceneLayout]:
        """A row's additional file and what it says. Raises InputError for a missing, changed or malformed file."""
        file = self._read(spec, spec.additional, spec.additional_sha256)
        file = mirrored_additional(file, self.catalog.signs) if self.catalog.image else file
        return file, read_layout(file.path, self.catalog, file.content)

    def _load_roads(self, spec: ScenarioSpec) -> Roads:
        key = spec.net_sha256 + spec.net
        roads = self._roads.get(key)
        if roads is None:
            file = self._read(spec, spec.net, spec.net_sha256)
            file = mirrored_network(file) if self.catalog.image else file
            network = read_network(file.path, file.content)
            roads = Roads(network, LaneGraph(network), LaneLocator(network), file)
            self._roads[key] = roads
            if len(self._roads) > _KEPT_NETWORKS:
                self._roads.popitem(last=False)
        self._roads.move_to_end(key)
        return roads

    def _read(self, spec: ScenarioSpec, name: str, wanted: str) -> SceneFile:
        """A scene file, read once; InputError where it is not the one that the row names."""
        file = self.files.read(spec, name)
        if sha256(file.content) != wanted:
            raise InputError(f"{file.path}: is not the file that row {spec.scenario_id} names (SHA-256 differs)")
        return file


def load_scene(data: DataSet, spec: ScenarioSpec) -> Scene:
    """The scene of one row, for callers that need one only."""
    return SceneLoader(data).load(spec)[0]
