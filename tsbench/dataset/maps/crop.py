"""Cuts the crop of a pool row out of its source network."""

from __future__ import annotations

from tsbench.core.errors import InputError
from tsbench.dataset.maps.cut import assemble
from tsbench.dataset.maps.families.family import REGISTRY
from tsbench.dataset.maps.families.roundabout import roundabout_chains
from tsbench.dataset.maps.merge import merge_chains, part_carriageways
from tsbench.dataset.maps.plain import PlainNet
from tsbench.dataset.maps.source import SourceNetwork
from tsbench.scenarios.map_pool import PoolRow


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
