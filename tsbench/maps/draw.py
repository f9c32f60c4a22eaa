"""Pictures of crops: lanes as bands, junctions, edges' directions; a sheet of several."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from tsbench.errors import InputError
from tsbench.maps.build import build_net
from tsbench.maps.crop import plain_crop
from tsbench.maps.netfile import read_net_facts
from tsbench.maps.paths import pool_file
from tsbench.maps.pool import PoolRow, read_pool
from tsbench.maps.source import SourceNetwork, load_source

_ROAD, _JUNCTION = "#9aa3ad", "#c9ced4"
_MARKS = {
    "signed_edge": "#1f6feb",
    "edge": "#1f6feb",
    "entry_edge": "#1f6feb",
    "short": "#d1242f",
    "compliant": "#2da44e",
}


def draw_sheet(crops: Sequence[tuple[PoolRow, SourceNetwork]], png: Path, columns: int = 5) -> None:
    """Cut, build and draw crops as one sheet; dual paths: approach blue, short red, compliant green."""
    rows = math.ceil(len(crops) / columns)
    figure = Figure(figsize=(3.2 * min(columns, len(crops)), 3.4 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(rows, min(columns, len(crops)))).ravel()
    for axis in axes:
        axis.set_axis_off()
    with tempfile.TemporaryDirectory(prefix="tsbench-draw-") as folder:
        for (row, source), axis in zip(crops, axes, strict=False):
            net = Path(folder) / f"{row.map_id}.net.xml"
            build_net(plain_crop(row, source), net)
            _draw(axis, row, net)
    png.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(png, dpi=90, metadata={"Software": None})


def _draw(axis: Any, row: PoolRow, net: Path) -> None:
    for shape in _junction_shapes(net):
        axis.add_patch(Polygon(shape, facecolor=_JUNCTION, edgecolor="none"))
    colours = _colours(row)
    for lane in read_net_facts(net).lanes:
        tangent = np.gradient(lane.line, axis=0)
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.hypot(*tangent.T)[:, None]
        half = (lane.width / 2 - 0.15) * normal
        band = np.vstack([lane.line + half, (lane.line - half)[::-1]])
        axis.add_patch(Polygon(band, facecolor=colours.get(lane.edge, _ROAD), edgecolor="none", alpha=0.8))
        middle = len(lane.line) // 2
        axis.annotate(
            "",
            lane.line[middle],
            lane.line[middle - 1],
            arrowprops={"arrowstyle": "->", "color": "white", "lw": 0.7},
        )
    axis.set_aspect("equal")
    axis.autoscale_view()
    note = row.slot or f"{row.lanes} lanes"
    axis.set_title(f"{row.map_id}\n{row.shape} {note} {row.length_m:.0f} m", fontsize=7)


def _colours(row: PoolRow) -> dict[str, str]:
    colours: dict[str, str] = {}
    for name, colour in _MARKS.items():
        value = row.fields.get(name, [])
        colours |= dict.fromkeys([value] if isinstance(value, str) else value, colour)
    return colours


def _junction_shapes(net: Path) -> list[np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    shapes = (
        e.get("shape", "").split() for e in etree.parse(str(net), parser).getroot().iterfind("junction")
    )
    return [
        np.array([[float(value) for value in point.split(",")[:2]] for point in shape])
        for shape in shapes
        if len(shape) > 2
    ]


def draw_maps(map_ids: Sequence[str], osm_dir: Path, png: Path) -> None:
    """Draw maps of the committed pool by id."""
    pool = {row.map_id: row for row in read_pool(pool_file())}
    unknown = [name for name in map_ids if name not in pool]
    if unknown:
        raise InputError(f"{unknown[0]}: no such map in {pool_file()}")
    rows = [pool[name] for name in map_ids]
    sources = {name: load_source(name, osm_dir) for name in sorted({row.source for row in rows})}
    draw_sheet([(row, sources[row.source]) for row in rows], png)
