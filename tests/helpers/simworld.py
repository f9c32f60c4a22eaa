"""Small networks and scenes made by hand, and the one simulation that this process may have.

`block`: a square block of streets with two tails,

    d ---- c
    |      |
    t ==== a ---- b ---- u        t-a has two lanes towards a: the right one goes straight on, the left one turns left

edges are named by their ends ("ta"), both directions exist. `cross`: main road west-east, secondary south-north.
`road`: 300 m, three lanes to the east.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from lxml import etree

from tsbench.core.xmlfile import read_plain, sha256
from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.plain import PlainConnection, PlainEdge, PlainNet, PlainNode
from tsbench.make.scenes.traffic import (
    Car,
    Driver,
    background,
    convoy_elements,
    driver_types,
    ego_elements,
    obstacle_elements,
    write_additional,
)
from tsbench.planners.registry import resolve
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneFolder, store_path, write_store
from tsbench.signs.annotations import SignInstance, plate_params
from tsbench.signs.catalog import load_catalog
from tsbench.sim.ego import Motion
from tsbench.sim.scene import ConvoyPlan, EgoStart, Obstacle, SceneLayout
from tsbench.sim.scene_file import layout_elements
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import Actors, ActorTable, EgoState

LIMIT, FAST = 13.89, 16.67
CALM = Driver(speed=9.0, accel=1.5, decel=2.5, headway=1.3, gap=2.0, length=4.5, width=1.8)


@cache
def simulation() -> Simulation:
    """The simulation of this process, whichever test asks for it."""
    return Simulation()


def loader_of(root: Path) -> SceneLoader:
    """Loads scenes whose files stand below a folder."""
    return SceneLoader(DataSet(), SceneFolder(root))


def driven(spec: ScenarioSpec, root: Path, planner: str = "idm", sim: Simulation | None = None) -> EpisodeResult:
    """An episode of a scene whose files stand below a folder."""
    return EpisodeRunner(resolve(planner), simulation=sim or simulation(), loader=loader_of(root)).run(spec)


def edge(a: PlainNode, b: PlainNode, lanes: int = 1, priority: int = 5, name: str = "") -> PlainEdge:
    return PlainEdge(name or a.id + b.id, a.id, b.id, lanes, LIMIT, priority, ((a.x, a.y), (b.x, b.y)))


def plain(nodes: Sequence[PlainNode], edges: Sequence[PlainEdge], *links: PlainConnection) -> PlainNet:
    return PlainNet(tuple(nodes), tuple(edges), tuple(links))


def block_plain() -> PlainNet:
    places = {"t": (-150, 0), "a": (0, 0), "b": (150, 0), "c": (150, 150), "d": (0, 150), "u": (300, 0)}
    n = {k: PlainNode(k, float(x), float(y)) for k, (x, y) in places.items()}
    pairs = ["ta", "ab", "bc", "cd", "da", "bu"]
    edges = [edge(n[p[0]], n[p[1]], 2 if p == "ta" else 1) for p in pairs]
    edges += [edge(n[p[1]], n[p[0]]) for p in pairs]
    return plain(list(n.values()), edges, PlainConnection("ta", "ab", 0, 0), PlainConnection("ta", "ad", 1, 0))


def cross_plain() -> PlainNet:
    arms = {"w": (-150.0, 0.0), "e": (150.0, 0.0), "s": (0.0, -150.0), "n": (0.0, 150.0)}
    middle = PlainNode("x", 0.0, 0.0)
    n = {k: PlainNode(k, x, y) for k, (x, y) in arms.items()}
    edges = []
    for k, node in n.items():
        priority = 9 if k in "we" else 1
        edges += [edge(node, middle, 1, priority, f"{k}_in"), edge(middle, node, 1, priority, f"{k}_out")]
    return plain([middle, *n.values()], edges)


def road_plain(length: float = 300.0, lanes: int = 3, speed: float = LIMIT) -> PlainNet:
    a, b = PlainNode("a", 0.0, 0.0), PlainNode("b", length, 0.0)
    return plain([a, b], [replace(edge(a, b, lanes, name="road"), speed=speed)])


def place(network: RoadNetwork, lane_id: str, s: float, d: float = 0.0) -> tuple[float, float, float]:
    """x, y, heading at a place of a lane."""
    line = network.lane(lane_id).line
    return (*line.point_at(s, d), line.heading_at(s))


def motion_at(network: RoadNetwork, lane_id: str, s: float, speed: float = 0.0) -> Motion:
    return Motion(*place(network, lane_id, s), speed)


def ego_at(
    network: RoadNetwork, lane_id: str, s: float, speed: float = 0.0, d: float = 0.0, on_road: bool = True
) -> EgoState:
    """An ego that stands as its lane does."""
    x, y, heading = place(network, lane_id, s, d)
    index = network.lane(lane_id).index
    return EgoState(x, y, heading, speed, 0.0, 0.0, 0.0, index, s, d, on_road)


def plate(
    network: RoadNetwork, edge_id: str, s: float, code: str = "3.1", value: float | None = None, **params: str
) -> SignInstance:
    """A plate 1.2 m right of an edge; its rule's params as keywords."""
    lane = network.edge_lanes(edge_id)[0]
    x, y = lane.line.point_at(s, -(lane.width / 2 + 1.2))
    told = plate_params(load_catalog().sign(code).rule.name, params) if params else None
    heading = lane.line.heading_at(s)
    return SignInstance("sign_0", code, value, edge_id, -1, s, x, y, heading, "target", None, told)


def speed_plate(network: RoadNetwork, edge_id: str, s: float, value: float = 40.0) -> SignInstance:
    return plate(network, edge_id, s, "3.24", value, zone_edges=edge_id)


def obstacle(network: RoadNetwork, lane_id: str, s: float, name: str = "obstacle_0") -> Obstacle:
    x, y, heading = place(network, lane_id, s)
    return Obstacle(name, "cones", x, y, heading, 4.9, 1.0, lane_id)


def actors(*bodies: tuple[float, float, float, float, float]) -> Actors:
    """Cars by centre x, y, heading, length, width."""
    table = ActorTable(2)
    for k, (_, _, _, length, width) in enumerate(bodies):
        table.add(f"car{k}", 0, length, width, ())  # type: ignore[arg-type]
    n = len(bodies)
    pose = np.array([b[:3] for b in bodies], dtype=np.float64).reshape(-1, 3)
    index = np.arange(n, dtype=np.int32)
    return Actors(table, index, pose, np.zeros(n), np.full(n, -1, dtype=np.int32), np.zeros(n))


class SceneMaker:
    """Writes scenes over one network below a `scenarios/` folder, and the rows that name them."""

    def __init__(self, root: Path, net: Path, network: RoadNetwork) -> None:
        self.root, self.net, self.network = root, net, network

    @classmethod
    def over(cls, roads: PlainNet, root: Path, name: str = "roads") -> SceneMaker:
        """A maker of scenes over a network that is built for them."""
        net = root / f"{name}.net.xml.gz"
        build_net(roads, net)
        return cls(root, net, read_network(net))

    def make(
        self, name: str, start: EgoStart, destination: Destination, route: Sequence[str], sign: SignInstance,
        *, cars: Sequence[Car] = (), drivers: Sequence[Driver] = (CALM,), obstacles: Sequence[Obstacle] = (),
        convoy: ConvoyPlan | None = None, convoy_at: tuple[str, Sequence[float], Sequence[str]] | None = None,
        horizon: int = 300, change: Callable[[list[etree._Element]], object] | None = None,
    ) -> ScenarioSpec:  # fmt: skip
        """A scene as the builder writes one. convoy_at: lane, fronts and route of the convoy's vehicles."""
        network = self.network
        layout = SceneLayout((sign,), (sign.id,), tuple(obstacles), start, destination, convoy, tuple(route), ())
        elements = layout_elements(layout, network) + obstacle_elements(obstacles, network)
        elements += driver_types(drivers) + ego_elements(start, network, route)
        if convoy_at is not None:
            lane, fronts, edges = convoy_at
            order = network.lane(lane).order
            elements += convoy_elements([CALM] * len(fronts), [(front, order, edges) for front in fronts])
        elements += background(cars)
        if change is not None:
            change(elements)
        path = self.root / f"{name}.add.xml.gz"
        write_additional(elements, path)
        return ScenarioSpec(
            scenario_id=name, scenario_type="yield", group="priority", sign_code=sign.code, sign_value=sign.value,
            map_id="hand-made", family="junction", shape="X", slot="", variant=0, split="test", seed=7,
            initial_speed=start.speed, route_length=50.0, density=0.0, drivers=-1, layout=0, horizon=horizon,
            net=self.net.relative_to(self.root).as_posix(), additional=path.name,
            net_sha256=sha256(read_plain(self.net, "network")),
            additional_sha256=sha256(read_plain(path, "scene file")),
        )  # fmt: skip

    def path(self, spec: ScenarioSpec) -> Path:
        return self.root / spec.additional


def store_scenes(rows: Sequence[ScenarioSpec], built: Path, root: Path) -> None:
    """Stores below `root` with the files of rows that stand below `built`, as a build ends."""
    stores: dict[Path, dict[str, dict[str, bytes]]] = {}
    folder = SceneFolder(built)
    for row in rows:
        maps = stores.setdefault(store_path(row.split, row.pair_type, root), {})
        files = maps.setdefault(row.map_id, {})
        files |= {name: folder.read(row, name).content for name in (row.net, row.additional)}
    for path, maps in stores.items():
        write_store(maps.items(), path)
