"""From a scenario row to a loaded scene, with the parsed network kept for the rows that share it."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

from tsbench.errors import InputError
from tsbench.maps.network import RoadNetwork, read_network
from tsbench.paths import data_root
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.lanegraph import LaneGraph
from tsbench.sim.place import LaneLocator
from tsbench.sim.scene import Scene
from tsbench.sim.scene_file import read_layout, scene_from_layout
from tsbench.xmlfile import read_plain, sha256

_KEPT_NETWORKS = 4


@dataclass(frozen=True)
class Roads:
    """A network with what is derived from it once."""

    network: RoadNetwork
    graph: LaneGraph
    locator: LaneLocator


class SceneLoader:
    """Loads scenes below `root` (default: the data folder's `scenarios/`), checking each file against its row."""

    def __init__(self, root: Path | None = None) -> None:
        self.root = data_root() / "scenarios" if root is None else root
        self._roads: OrderedDict[str, Roads] = OrderedDict()

    def load(self, spec: ScenarioSpec) -> tuple[Scene, Roads]:
        """The scene of a row. Raises InputError for a missing, changed or malformed file."""
        net, additional = self.root / spec.net, self.root / spec.additional
        content = _content(additional, spec.additional_sha256, spec)
        roads = self._load_roads(spec, net)
        layout = read_layout(additional, content)
        return scene_from_layout(layout, roads.network, net, additional, spec.horizon, spec.seed), roads

    def _load_roads(self, spec: ScenarioSpec, net: Path) -> Roads:
        key = spec.net_sha256 + spec.net
        roads = self._roads.get(key)
        if roads is None:
            network = read_network(net, _content(net, spec.net_sha256, spec))
            roads = Roads(network, LaneGraph(network), LaneLocator(network))
            self._roads[key] = roads
            if len(self._roads) > _KEPT_NETWORKS:
                self._roads.popitem(last=False)
        self._roads.move_to_end(key)
        return roads


def _content(path: Path, wanted: str, spec: ScenarioSpec) -> bytes:
    """A scene file's content, read once; InputError where it is not the one that the row names."""
    content = read_plain(path, "scene file")
    if sha256(content) != wanted:
        raise InputError(f"{path}: is not the file that row {spec.scenario_id} names (SHA-256 differs)")
    return content


def load_scene(spec: ScenarioSpec, root: Path | None = None) -> Scene:
    """The scene of one row, for those who need no more than one."""
    return SceneLoader(root).load(spec)[0]
