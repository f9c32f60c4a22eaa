"""From a scenario row to a loaded scene, with the parsed network kept for the rows that share it."""

from __future__ import annotations

import gzip
import hashlib
import zlib
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

_KEPT_NETWORKS = 4


@dataclass(frozen=True)
class Roads:
    """A network with what is derived from it once."""

    network: RoadNetwork
    graph: LaneGraph
    locator: LaneLocator


def content_sha256(path: Path) -> str:
    """SHA-256 of a file's content, uncompressed if it is gzip. Raises InputError."""
    try:
        raw = path.read_bytes()
        data = gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw
    except FileNotFoundError:
        raise InputError(f"{path}: no such scene file (tsbench scenarios build makes it)") from None
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    return hashlib.sha256(data).hexdigest()


class SceneLoader:
    """Loads scenes below `root` (default: the data folder's `scenarios/`), checking each file against its row."""

    def __init__(self, root: Path | None = None) -> None:
        self.root = data_root() / "scenarios" if root is None else root
        self._roads: OrderedDict[str, Roads] = OrderedDict()

    def load(self, spec: ScenarioSpec) -> tuple[Scene, Roads]:
        """The scene of a row. Raises InputError for a missing, changed or malformed file."""
        net, additional = self.root / spec.net, self.root / spec.additional
        if content_sha256(additional) != spec.additional_sha256:
            raise InputError(
                f"{additional}: is not the file that row {spec.scenario_id} names (SHA-256 differs)"
            )
        roads = self._load_roads(spec, net)
        layout = read_layout(additional)
        return scene_from_layout(layout, roads.network, net, additional, spec.horizon, spec.seed), roads

    def _load_roads(self, spec: ScenarioSpec, net: Path) -> Roads:
        key = spec.net_sha256 + spec.net
        roads = self._roads.get(key)
        if roads is None:
            if content_sha256(net) != spec.net_sha256:
                raise InputError(
                    f"{net}: is not the file that row {spec.scenario_id} names (SHA-256 differs)"
                )
            network = read_network(net)
            roads = Roads(network, LaneGraph(network), LaneLocator(network))
            self._roads[key] = roads
            if len(self._roads) > _KEPT_NETWORKS:
                self._roads.popitem(last=False)
        self._roads.move_to_end(key)
        return roads


def load_scene(spec: ScenarioSpec, root: Path | None = None) -> Scene:
    """The scene of one row, for those who need no more than one."""
    return SceneLoader(root).load(spec)[0]
