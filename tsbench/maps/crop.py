"""Cuts the crop of a pool row out of its source network, and builds it."""

from __future__ import annotations

from tsbench.errors import InputError
from tsbench.maps.build import build_net
from tsbench.maps.cut import assemble
from tsbench.maps.families.registry import REGISTRY
from tsbench.maps.families.roundabout import roundabout_chains
from tsbench.maps.merge import merge_chains, part_carriageways
from tsbench.maps.plain import PlainNet
from tsbench.maps.pool import PoolRow
from tsbench.maps.source import SourceNetwork

__all__ = ["build_net", "plain_crop"]


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
