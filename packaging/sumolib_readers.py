"""Times sumolib's readers of SUMO's files beside tsbench's own, and compares what they return.

python packaging/sumolib_readers.py [EXTRACT]

Committed networks and scene files of the split dev; the plain XML of an extract. Processor time, the best of three.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import sumolib.net
import sumolib.xml

from tsbench.make.city import find_extract, sources_dir
from tsbench.make.maps.netconvert import convert_to_plain, sumo_binary
from tsbench.make.maps.plain import parse_edges, parse_nodes
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.store import SceneStore
from tsbench.sim.scene_file import read_additional


def best(work: Callable[[], object]) -> float:
    """Seconds of processor time."""
    times = []
    for _ in range(3):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def told(what: str, ours: Callable[[], object], others: Callable[[], object], count: int, note: str) -> None:
    one, other = best(ours), best(others)
    print(f"{what}: tsbench {one / count * 1e3:.2f} ms, sumolib {other / count * 1e3:.2f} ms each; {note}")


def sumolib_net(path: Path) -> sumolib.net.Net:
    return sumolib.net.readNet(str(path), withInternal=True)


def unlike(network: RoadNetwork, net: sumolib.net.Net) -> int:
    """Lanes that differ in shape, length, limit, width or in whether cars may use them."""
    lanes = {lane.getID(): lane for edge in net.getEdges() for lane in edge.getLanes()}
    return sum(
        (one.getLength(), one.getSpeed(), one.getWidth(), one.allows("passenger"))
        != (lane.length, lane.speed, lane.width, lane.permits("passenger"))
        or (not lane.internal and one.getShape() != [tuple(p) for p in lane.line.points.tolist()])
        for lane in network.lanes
        for one in [lanes[lane.id]]
    )


def main(extract: str) -> None:
    rows = [row for row in DataSet().table("dev") if row.variant == 0][::6]
    store = SceneStore(DataSet())
    with tempfile.TemporaryDirectory(prefix="tsbench-sumolib-") as name:
        folder = Path(name)
        nets: list[Path] = []
        scenes: list[Path] = []
        for number, row in enumerate(rows):
            for kind, file, paths in (("net", row.net, nets), ("add", row.additional, scenes)):
                paths.append(folder / f"{number}.{kind}.xml")
                paths[-1].write_bytes(store.read(row, file).content)
        same = [unlike(read_network(path), sumolib_net(path)) for path in nets]
        told(
            f"{len(nets)} networks",
            lambda: [read_network(path) for path in nets],
            lambda: [sumolib_net(path) for path in nets],
            len(nets),
            f"{sum(same)} lanes differ",
        )
        told(
            f"{len(scenes)} scene files",
            lambda: [read_additional(path) for path in scenes],
            lambda: [list(sumolib.xml.parse(str(path), heterogeneous=True)) for path in scenes],
            len(scenes),
            "the tree alone",
        )
        convert_to_plain(DataSet(), find_extract(DataSet(), extract, sources_dir()), folder)
        files = (folder / "net.nod.xml", folder / "net.edg.xml")
        told(
            f"plain XML of {extract}, {files[1].stat().st_size / 1e6:.1f} MB of edges",
            lambda: parse_edges(files[1], parse_nodes(files[0])),
            lambda: [
                list(sumolib.xml.parse(str(p), k, heterogeneous=True))
                for p, k in zip(files, ("node", "edge"), strict=True)
            ],
            1,
            f"{len(parse_edges(files[1], parse_nodes(files[0])))} edges",
        )
    print("netconvert:", sumo_binary("netconvert") == Path(sumolib.checkBinary("netconvert")))


if __name__ == "__main__":
    main(*sys.argv[1:] or ["zamoskvorechye"])
