"""Maps of the pool on a sheet: their roads with the directions of lanes, and what their family marks."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import shapely

from tsbench.core.errors import InputError
from tsbench.geometry.overlap import strip
from tsbench.make.maps.crop import plain_crop
from tsbench.make.maps.netconvert import build_net
from tsbench.make.maps.source import SourceNetwork, load_source
from tsbench.report.drawing.canvas import STYLE, Area, Image, camera_over
from tsbench.report.drawing.paint import paint, save_png, sheet
from tsbench.report.drawing.road_shapes import mark_shapes, road_shapes
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.map_pool import PoolRow, read_pool

_COLUMNS, _WIDTH_PX, _HEIGHT_PX = 5, 300, 280
# Of dual paths: approach, short way, compliant way.
_ROUTES = ("signed_edge", "edge", "entry_edge")
_MARKS = {**dict.fromkeys(_ROUTES, "route"), "short": "violation", "compliant": "compliant"}
_ARROW_M = np.array([(1.6, 0.0), (-1.0, 0.9), (-1.0, -0.9)])


def draw_maps(data: DataSet, map_ids: Sequence[str], osm_dir: Path, png: Path) -> None:
    """Draw maps of the committed pool by id. Raises InputError: an unknown map, an extract that is not there."""
    pool = {row.map_id: row for row in read_pool(data.pool_path)}
    unknown = [name for name in map_ids if name not in pool]
    if unknown:
        raise InputError(f"{unknown[0]}: no such map in {data.pool_path}")
    rows = [pool[name] for name in map_ids]
    sources = {name: load_source(data, name, osm_dir) for name in sorted({row.source for row in rows})}
    save_png(png, map_sheet([(row, sources[row.source]) for row in rows]))


def map_sheet(crops: Sequence[tuple[PoolRow, SourceNetwork]]) -> Image:
    panels = []
    with tempfile.TemporaryDirectory(prefix="tsbench-draw-") as folder:
        for row, source in crops:
            net = Path(folder) / f"{row.map_id}.net.xml"
            build_net(plain_crop(row, source), net)
            note = row.slot or f"{row.lanes} lanes"
            title = f"{row.map_id}\n{row.shape} {note} {row.length_m:.0f} m"
            panels.append((title, _picture(row, read_network(net))))
    return sheet(panels, _COLUMNS)


def _picture(row: PoolRow, network: RoadNetwork) -> Image:
    lines = np.concatenate([lane.line.points for lane in network.lanes])
    camera = camera_over(lines, _WIDTH_PX, _HEIGHT_PX, 6.0, (0.1, 12.0))
    image = np.full((_HEIGHT_PX, _WIDTH_PX, 3), STYLE.ground, dtype=np.uint8)
    paint(image, camera, (*road_shapes(network), *mark_shapes(network), *_marks(row, network)))
    return image


def _marks(row: PoolRow, network: RoadNetwork) -> Iterator[Area]:
    for name, colour in _MARKS.items():
        value = row.fields.get(name, [])
        lanes = [lane for e in ([value] if isinstance(value, str) else value) for lane in network.edge_lanes(e)]
        yield Area(colour, shapely.union_all([strip(lane.line, lane.width - 0.3) for lane in lanes]), 0.8)
    for lane in network.lanes:
        if not lane.internal:
            s = lane.line.length / 2
            heading = lane.line.heading_at(s)
            turn = np.array([(np.cos(heading), np.sin(heading)), (-np.sin(heading), np.cos(heading))])
            yield Area("marking", shapely.Polygon(_ARROW_M @ turn + lane.line.point_at(s)))
