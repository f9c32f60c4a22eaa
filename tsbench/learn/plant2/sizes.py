"""Extents of the network, for its training by torch and its use without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tsbench.core.errors import InputError
from tsbench.planners.weights import Network


@dataclass(frozen=True, slots=True)
class Size:
    """Extents of a network. patch: channels of the patch encoder's stages; () = tiles. dropout: of the encoder."""

    layers: int
    width: int
    heads: int
    feedforward: int
    patch: tuple[int, ...]
    hidden: int
    dropout: float


SIZES: Mapping[str, Size] = {
    "medium": Size(8, 512, 8, 2048, (64, 128, 256, 512), 128, 0.1),
    # A million parameters learn far fewer frames by heart than they are shown; drawing masks is a fifth of a step.
    "mini": Size(4, 128, 4, 512, (), 128, 0.0),
}
# What is asked of the encoder: a learned query each, in this order, before all other tokens.
PATH, WAYPOINT, SPEED, QUERIES = 0, 1, 2, 3
TILE, TILE_FEATURES = 8, 32


def size_of(base: Network) -> str:
    """A name of SIZES; InputError where the facts of some weights name none."""
    size = str(base.training.get("size", ""))
    if size not in SIZES:
        raise InputError(f"weights {base.name!r}: size {size!r}, expected {' or '.join(SIZES)}")
    return size
