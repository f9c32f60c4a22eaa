"""The four families by name: how each finds its maps, and the pieces of a map's crop."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from tsbench.dataset.maps.cut import EdgePiece
from tsbench.dataset.maps.families.corridor import corridor_pieces, find_corridors
from tsbench.dataset.maps.families.dual_path import dual_path_pieces, find_dual_paths
from tsbench.dataset.maps.families.junction import find_junctions, junction_pieces
from tsbench.dataset.maps.families.roundabout import find_roundabouts, roundabout_pieces
from tsbench.dataset.maps.source import SourceNetwork
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
