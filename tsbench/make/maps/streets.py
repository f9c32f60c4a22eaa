"""What kind of streets an extract has: OSMnx's statistics of its street network, over the roads that tsbench takes.

Source: Boeing (2017, 2019), as OSMnx computes them. Roads are those of `road_tags`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import networkx
import osmium
import osmnx
from matplotlib.figure import Figure

from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.make.maps.osm import read_extract

# Arms of an intersection that are told apart; this many and more are one class.
_MOST_ARMS = 5
_COLUMNS = 4


@dataclass(frozen=True)
class Streets:
    """The street network of one extract.

    area_km2: of the convex hull of its streets. street_km: of streets, each counted once. intersections: nodes of
    three arms and more; arms: share of these with 3, 4, and 5 and more (_MOST_ARMS). dead_ends: share of all nodes.
    segment_m: mean length between two nodes. circuity: length along streets over the straight line, mean by length.
    entropy: of the compass bearings of streets in 36 bins, nats; ln 36 = 3.58 where no direction is preferred, ln 4 =
    1.39 for a perfect grid.
    """

    extract: str
    area_km2: float
    street_km: float
    intersections: int
    arms: Mapping[int, float]
    dead_ends: float
    segment_m: float
    circuity: float
    entropy: float

    @property
    def density(self) -> float:
        """Intersections per km2."""
        return self.intersections / self.area_km2


def graph_of(extract: Path) -> Any:
    """The street network of an extract as OSMnx has it: unprojected, simplified, with compass bearings.

    Raises InputError as `read_extract` does.
    """
    with tempfile.TemporaryDirectory(prefix="tsbench-streets-") as folder:
        plain, roads = Path(folder, "plain.osm"), Path(folder, "roads.osm")
        taken = read_extract(extract, plain).road_ends.keys()
        _write_roads(plain, roads, taken)
        found = osmnx.graph_from_xml(roads, retain_all=True)
    networkx.set_node_attributes(found, osmnx.stats.count_streets_per_node(found), "street_count")
    return osmnx.add_edge_bearings(found)


def _write_roads(plain: Path, roads: Path, taken: Iterable[int]) -> None:
    """Only these ways, and the nodes that they have."""
    ways = frozenset(taken)
    used = {ref.ref for way in osmium.FileProcessor(str(plain), osmium.osm.WAY) if way.id in ways for ref in way.nodes}
    with osmium.SimpleWriter(str(roads), overwrite=True) as writer:
        for one in osmium.FileProcessor(str(plain), osmium.osm.NODE | osmium.osm.WAY):
            if one.id in (used if one.is_node() else ways):
                writer.add(one)


def streets_of(name: str, graph: networkx.MultiDiGraph) -> Streets:
    """The statistics of a network of `graph_of`. name: of its extract."""
    projected = osmnx.project_graph(graph)
    area_m2 = float(osmnx.graph_to_gdfs(projected, nodes=False).union_all().convex_hull.area)
    told = osmnx.basic_stats(projected, area=area_m2)
    counts = told["streets_per_node_counts"]
    arms = dict.fromkeys(range(3, _MOST_ARMS + 1), 0)
    for count, nodes in counts.items():
        if count >= min(arms):
            arms[min(count, _MOST_ARMS)] += nodes
    intersections = sum(arms.values())
    return Streets(
        extract=name,
        area_km2=area_m2 / 1e6,
        street_km=told["street_length_total"] / 1e3,
        intersections=intersections,
        arms={count: nodes / intersections if intersections else 0.0 for count, nodes in arms.items()},
        dead_ends=counts.get(1, 0) / told["n"],
        segment_m=told["street_length_avg"],
        circuity=told["circuity_avg"],
        entropy=float(osmnx.orientation_entropy(osmnx.convert.to_undirected(graph), weight="length")),
    )


def draw_bearings(graphs: Mapping[str, networkx.MultiDiGraph], path: Path) -> None:
    """A compass rose of street bearings for each network, by length, as a PNG."""
    rows = -(-len(graphs) // _COLUMNS)
    figure = Figure(figsize=(4.0 * min(len(graphs), _COLUMNS), 4.4 * rows))
    for k, (name, graph) in enumerate(graphs.items(), start=1):
        axes: Any = figure.add_subplot(rows, min(len(graphs), _COLUMNS), k, projection="polar")
        osmnx.plot.plot_orientation(
            osmnx.convert.to_undirected(graph),
            ax=axes,
            weight="length",
            title=name,
            title_y=1.1,
            title_font={"size": 14},
        )
    figure.suptitle("© OpenStreetMap contributors, ODbL 1.0", fontsize=8, y=0.01, va="bottom")
    with io_errors_as_input_errors(path), replacing(path) as part:
        figure.savefig(part, format="png", dpi=60)
