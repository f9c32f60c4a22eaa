"""Cuts the crop of a pool row out of its source network."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from tsbench.core.errors import InputError
from tsbench.make.maps.cut import EdgePiece, assemble
from tsbench.make.maps.families.corridor import corridor_pieces, find_corridors
from tsbench.make.maps.families.dual_path import dual_path_pieces, find_dual_paths
from tsbench.make.maps.families.junction import find_junctions, junction_pieces
from tsbench.make.maps.families.roundabout import find_roundabouts, roundabout_chains, roundabout_pieces
from tsbench.make.maps.merge import merge_chains, part_carriageways
from tsbench.make.maps.plain import PlainNet
from tsbench.make.maps.source import SourceNetwork
from tsbench.scenarios.map_pool import PoolRow


@dataclass(frozen=True)
class Family:
    """`find` yields a source's maps and counts what it refused; `pieces` cuts one by its row's detail."""

    find: Callable[[SourceNetwork, Counter[str]], Iterator[PoolRow]]
    pieces: Callable[[SourceNetwork, dict[str, Any]], list[EdgePiece]]


REGISTRY: dict[str, Family] = {
    "junction": Family(find_junctions, junction_pieces),
    "roundabout": Family(find_roundabouts, roundabout_pieces),
    "dual_path": Family(find_dual_paths, dual_path_pieces),
    "corridor": Family(find_corridors, corridor_pieces),
}


def plain_crop(row: PoolRow, source: SourceNetwork) -> PlainNet:
    """The crop as plain elements: edge and node ids of the source, metres around the crop's centre.

    Dead ends made by a cut are called `<edge id>.start` or `.end` after the edge that was cut there.
    """
    if source.name != row.source:
        raise InputError(f"{row.map_id}: cut from '{row.source}', not from '{source.name}'")
    detail = row.fields
    try:
        pieces = REGISTRY[row.family].pieces(source, detail)
    except KeyError as missing:
        raise InputError(
            f"{row.map_id}: no edge {missing} in this '{source.name}'; "
            f"the pool is from another version of the extract, run `tsbench maps harvest`"
        ) from missing
    if row.family != "roundabout":
        return assemble(source, pieces)
    plain = merge_chains(assemble(source, pieces, [detail["ring"]]), roundabout_chains(detail))
    return part_carriageways(plain, detail["arms"])
