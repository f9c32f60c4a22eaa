"""What all families' rows share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tsbench.make.maps.cut import EdgePiece
from tsbench.make.maps.extracts import extract_info
from tsbench.make.maps.lines import cut
from tsbench.make.maps.source import SourceNetwork
from tsbench.make.maps.utm import Floats
from tsbench.scenarios.map_pool import PoolRow, map_id


def piece_line(source: SourceNetwork, piece: EdgePiece) -> Floats:
    return cut(source.line(piece.row), piece.start, min(piece.end, float(source.lengths[piece.row])))


def osm_nodes(node_id: str) -> list[str]:
    """The OSM nodes of a junction: a joined one is called `cluster_1_2_3`."""
    return node_id.removeprefix("cluster_").split("_") if node_id.startswith("cluster_") else [node_id]


def make_row(
    source: SourceNetwork,
    *,
    family: str,
    shape: str,
    ids: Sequence[str],
    pieces: Sequence[EdgePiece],
    main: Sequence[int],
    junctions: Iterable[int],
    curvature: float,
    length_m: float,
    detail: dict[str, Any],
    slot: str = "",
) -> PoolRow:
    """A row: `pieces` bound the crop, `main` edges give lanes, speed and class, `junctions` are node rows."""
    extract = extract_info(source.name)
    points = np.vstack([piece_line(source, piece) for piece in pieces])
    low, high = points.min(axis=0), points.max(axis=0)
    east, north = ((low + high) / 2).tolist()
    half_w, half_h = ((high - low) / 2).tolist()
    lat, lon = source.frame.to_degrees(east, north).tolist()
    first = max(main, key=lambda row: (int(source.priority[row]), int(source.lanes[row]), -row))
    lanes = max(int(source.lanes[row]) for row in main)
    return PoolRow(
        map_id=map_id(family, extract.code, *ids),
        family=family,
        shape=shape,
        slot=slot,
        lat=round(lat, 6),
        lon=round(lon, 6),
        source=source.name,
        well_tagged=extract.well_tagged,
        osm_ids=tuple(sorted({way for piece in pieces for way in source.osm_ids[piece.row]})),
        junction_ids=tuple(sorted({name for node in junctions for name in osm_nodes(source.node_ids[node])})),
        east=round(east, 1),
        north=round(north, 1),
        half_w=round(half_w, 1),
        half_h=round(half_h, 1),
        lanes=lanes,
        lane_bucket=min(lanes, 3),
        oneway=all(source.opposite[row] < 0 for row in main),
        curvature=round(curvature, 4),
        length_m=round(length_m, 1),
        speed_mps=float(source.speed[first]),
        road_class=source.road_class[first],
        detail=json.dumps(detail, separators=(",", ":")),
    )
