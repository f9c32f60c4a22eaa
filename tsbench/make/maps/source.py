"""A source network: a whole extract as compact arrays, parsed once and cached under `sumo_nets/build/`."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError
from tsbench.core.files import replacing, sha256_of
from tsbench.make.city import build_dir, find_extract, load_city, netconvert_file, types_file
from tsbench.make.maps.extracts import extract_name
from tsbench.make.maps.netconvert import convert_to_plain
from tsbench.make.maps.plain import (
    ParsedEdge,
    class_speeds,
    parse_edges,
    parse_nodes,
    parse_projection,
    parse_roundabouts,
)
from tsbench.make.maps.road_tags import FASTEST_MPS
from tsbench.make.maps.utm import WIDEST_M, Floats, UtmFrame, frame_of
from tsbench.scenarios.data_set import DataSet

SCHEMA = 6
Ints = npt.NDArray[np.int64]
_END_COLUMNS = ("tail", "head")
_NUMBER_COLUMNS = ("lanes", "priority", "speed", "width", "centred")
_EDGE_COLUMNS = (*_END_COLUMNS, *_NUMBER_COLUMNS)
_TEXT_COLUMNS = ("road_class", "street")


@dataclass(frozen=True)
class SourceNetwork:
    """Nodes and directed car edges of one extract; metres in `frame`; all sorted by id.

    `node_xy` (n, 2); `tail`/`head` (m,) node rows; `points` (p, 2) with `first` (m + 1,) offsets per edge;
    `osm_ids` per edge; `rings`: edge ids of each roundabout; `signals` (s, 2) places of traffic signals;
    `notes`: what of the extract was not taken as it is; `data`: whose extract it is.
    """

    data: DataSet
    name: str
    frame: UtmFrame
    node_ids: list[str]
    node_xy: Floats
    edge_ids: list[str]
    tail: Ints
    head: Ints
    lanes: Ints
    priority: Ints
    speed: Floats
    width: Floats
    road_class: list[str]
    street: list[str]
    centred: npt.NDArray[np.bool_]
    osm_ids: list[list[int]]
    first: Ints
    points: Floats
    rings: list[list[str]]
    signals: Floats
    notes: list[str]

    @cached_property
    def edge_row(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.edge_ids)}

    @cached_property
    def out_edges(self) -> list[list[int]]:
        return _group(self.tail, len(self.node_ids))

    @cached_property
    def in_edges(self) -> list[list[int]]:
        return _group(self.head, len(self.node_ids))

    @cached_property
    def lengths(self) -> Floats:
        """Length of each edge's line, (m,) metres."""
        steps = np.hypot(*np.diff(self.points, axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        result: Floats = along[self.first[1:] - 1] - along[self.first[:-1]]
        return result

    @cached_property
    def opposite(self) -> Ints:
        """Row of the edge on the same line the other way, or -1, (m,)."""
        by_ends: dict[tuple[int, int], list[int]] = {}
        for row, ends in enumerate(zip(self.tail.tolist(), self.head.tolist(), strict=True)):
            by_ends.setdefault(ends, []).append(row)
        result = np.full(len(self.edge_ids), -1, np.int64)
        for (tail, head), rows in by_ends.items():
            for row in rows:
                for other in by_ends.get((head, tail), ()):
                    if other != row and _same_line(self.line(row), self.line(other)[::-1]):
                        result[row] = other
        return result

    def line(self, row: int) -> Floats:
        """The edge's line from tail to head, (k, 2) metres."""
        return self.points[self.first[row] : self.first[row + 1]]


def _same_line(one: Floats, other: Floats) -> bool:
    return len(one) == len(other) and bool(np.abs(one - other).max() < 0.5)


def _group(keys: Ints, count: int) -> list[list[int]]:
    groups: list[list[int]] = [[] for _ in range(count)]
    for row, key in enumerate(keys.tolist()):
        groups[key].append(row)
    return groups


@lru_cache(maxsize=8)
def kept_source(data: DataSet, name: str, osm_dir: Path) -> SourceNetwork:
    """The network of an extract, kept in this process from task to task."""
    return load_source(data, name, osm_dir)


def load_source(data: DataSet, name: str, osm_dir: Path) -> SourceNetwork:
    """The network of an extract, from the cache if it was made from the same bytes and configuration."""
    extract = find_extract(data, name, osm_dir)
    configuration = (netconvert_file("extract.netccfg"), types_file(data))
    key = "-".join([sha256_of(extract)[:16], *(sha256_of(part)[:8] for part in configuration)])
    if load_city(data.name).frame.mirrored:
        key += "-mirrored"
    cache = build_dir() / "sources" / f"{name}-{SCHEMA}-{key}.parquet"
    if not cache.is_file():
        _write(_convert(data, extract), cache)
    return _read(data, cache)


def _convert(data: DataSet, extract: Path) -> SourceNetwork:
    with tempfile.TemporaryDirectory(prefix="tsbench-source-") as folder:
        facts = convert_to_plain(data, extract, Path(folder))
        node_file = Path(folder) / "net.nod.xml"
        nodes, used = parse_nodes(node_file), frame_of(parse_projection(node_file), str(extract))
        frame = replace(used, mirrored=load_city(data.name).frame.mirrored)
        edge_file = Path(folder) / "net.edg.xml"
        edges = [_with_its_class_speed(data, edge) for edge in parse_edges(edge_file, nodes)]
        rings = parse_roundabouts(edge_file)
    if not edges:
        raise InputError(f"{extract}: netconvert found no road for cars in it")
    east, north = np.ptp(np.array(list(nodes.values()), float), axis=0).tolist()
    if max(east, north) > WIDEST_M:
        raise InputError(
            f"{extract}: its roads lie {max(east, north) / 1e3:.0f} km apart, more than one city (at most "
            f"{WIDEST_M / 1e3:.0f} km): cut out one with `osmium extract`"
        )
    row = {name: index for index, name in enumerate(nodes)}
    columns: dict[str, Any] = {name: [getattr(edge, name) for edge in edges] for name in _TEXT_COLUMNS}
    columns |= {name: np.array([row[getattr(edge, name)] for edge in edges]) for name in _END_COLUMNS}
    columns |= {name: np.array([getattr(edge, name) for edge in edges]) for name in _NUMBER_COLUMNS}
    return SourceNetwork(
        data=data,
        name=extract_name(extract),
        frame=frame,
        node_ids=list(nodes),
        node_xy=np.array(list(nodes.values()), float),
        edge_ids=[edge.id for edge in edges],
        osm_ids=[edge.osm_ids for edge in edges],
        first=np.concatenate([[0], np.cumsum([len(edge.line) for edge in edges])]),
        points=np.concatenate([np.array(edge.line) for edge in edges]),
        rings=rings,
        signals=frame.to_metres(facts.signals[:, 0], facts.signals[:, 1]),
        notes=list(facts.notes),
        **columns,
    )


def _with_its_class_speed(data: DataSet, edge: ParsedEdge) -> ParsedEdge:
    """The edge with the limit of its class where the tagged one can be none."""
    if edge.speed <= FASTEST_MPS:
        return edge
    usual = class_speeds(types_file(data)).get(f"highway.{edge.road_class}", FASTEST_MPS)
    return replace(edge, speed=usual)


def _write(source: SourceNetwork, path: Path) -> None:
    columns: dict[str, Any] = {"id": pa.array(source.edge_ids)}
    columns |= {name: pa.array(getattr(source, name)) for name in _EDGE_COLUMNS}
    columns |= {name: pa.array(getattr(source, name)).dictionary_encode() for name in _TEXT_COLUMNS}
    columns["osm_ids"] = pa.array(source.osm_ids, pa.list_(pa.int64()))
    offsets = pa.array(source.first * 2, pa.int32())
    columns["line"] = pa.ListArray.from_arrays(offsets, pa.array(source.points.ravel()))
    extra = {
        "schema": SCHEMA,
        "name": source.name,
        "frame": [source.frame.zone, source.frame.south, source.frame.mirrored],
        "nodes": source.node_ids,
        "node_xy": source.node_xy.tolist(),
        "rings": source.rings,
        "signals": source.signals.tolist(),
        "notes": source.notes,
    }
    table = pa.table(columns).replace_schema_metadata({"tsbench": json.dumps(extra)})
    with replacing(path) as part:
        pq.write_table(table, part, compression="zstd")


def _read(data: DataSet, path: Path) -> SourceNetwork:
    # Not pq.read_table, whose import of pyarrow.dataset alone takes 50 MB.
    table: Any = pq.ParquetFile(path).read().combine_chunks()
    extra = json.loads(table.schema.metadata[b"tsbench"])
    line = table["line"].combine_chunks()
    columns: dict[str, Any] = {name: table[name].to_pylist() for name in _TEXT_COLUMNS}
    columns |= {name: np.asarray(table[name].to_numpy()) for name in _EDGE_COLUMNS}
    return SourceNetwork(
        data=data,
        name=extra["name"],
        frame=UtmFrame(*extra["frame"]),
        node_ids=extra["nodes"],
        node_xy=np.array(extra["node_xy"], float).reshape(-1, 2),
        edge_ids=table["id"].to_pylist(),
        osm_ids=table["osm_ids"].to_pylist(),
        first=line.offsets.to_numpy().astype(np.int64) // 2,
        points=line.values.to_numpy().reshape(-1, 2),
        rings=extra["rings"],
        signals=np.array(extra["signals"], float).reshape(-1, 2),
        notes=extra["notes"],
        **columns,
    )
