"""Where extracts overlap, the better-tagged one keeps the place: a test by geometry, ids are not shared."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from tsbench.dataset.maps.cut import EdgePiece
from tsbench.dataset.maps.families.common import piece_line
from tsbench.dataset.maps.lines import densified
from tsbench.dataset.maps.source import SourceNetwork

STEP_M = 10.0
NEAR_M = 30.0  # generalised shapes are off by up to 28 m
MAX_SHARE = 0.25


class Coverage:
    """The roads of better-tagged extracts, as points every 10 m."""

    def __init__(self, better: Sequence[SourceNetwork]) -> None:
        points = [
            densified(source.line(row), STEP_M) for source in better for row in range(len(source.edge_ids))
        ]
        self._tree = cKDTree(np.concatenate(points)) if points else None

    def holds(self, source: SourceNetwork, pieces: Sequence[EdgePiece]) -> bool:
        """Whether a better extract has the place: a quarter of the crop lies within 30 m of its roads."""
        if self._tree is None:
            return False
        points = np.concatenate([densified(piece_line(source, piece), STEP_M) for piece in pieces])
        distance, _ = self._tree.query(points, distance_upper_bound=NEAR_M)
        return bool(np.isfinite(distance).mean() > MAX_SHARE)
