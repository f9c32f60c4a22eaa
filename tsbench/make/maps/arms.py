"""The arms of a node: roads, not edges. An arm is a pair of opposite edges or a one-way edge."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from tsbench.geometry.angles import STRAIGHT_DEG, wrap_deg
from tsbench.make.maps.lines import heading_away
from tsbench.make.maps.source import SourceNetwork

ARM_HEADING_SPAN_M = 25.0


@dataclass(frozen=True, slots=True)
class Arm:
    """One road at a node: the rows of its edges in and out (None: one-way); the heading points outwards."""

    in_row: int | None
    out_row: int | None
    heading_deg: float
    length_m: float

    @property
    def rows(self) -> tuple[int, ...]:
        """The rows that exist, incoming first."""
        return tuple(row for row in (self.in_row, self.out_row) if row is not None)


def arms_of(source: SourceNetwork, node: int) -> list[Arm]:
    """All arms of a node, counter-clockwise from east. Loops at the node are left out."""
    arms = []
    used: set[int] = set()
    for out in source.out_edges[node]:
        if source.head[out] == node:
            continue
        back = int(source.opposite[out])
        if back >= 0:
            used.add(back)
        arms.append(_arm(source, back if back >= 0 else None, out))
    for inward in source.in_edges[node]:
        if inward not in used and source.tail[inward] != node:
            arms.append(_arm(source, inward, None))
    return sorted(arms, key=lambda arm: (arm.heading_deg % 360.0, arm.rows))


def _arm(source: SourceNetwork, in_row: int | None, out_row: int | None) -> Arm:
    if out_row is not None:
        line, length_m = source.line(out_row), float(source.lengths[out_row])
    else:
        assert in_row is not None  # an arm has at least one edge
        line, length_m = source.line(in_row)[::-1], float(source.lengths[in_row])
    return Arm(in_row, out_row, heading_away(line, ARM_HEADING_SPAN_M), length_m)


def least_separation(arms: list[Arm]) -> float:
    """The smallest angle between two arms, degrees."""
    return min(abs(wrap_deg(a.heading_deg - b.heading_deg)) for a, b in combinations(arms, 2))


def through_pairs(arms: list[Arm]) -> list[tuple[int, int]]:
    """Pairs of arms that go straight on (within 35 degrees), each arm in its best pair only."""
    bends = sorted(
        (180.0 - abs(wrap_deg(arms[i].heading_deg - arms[j].heading_deg)), i, j)
        for i, j in combinations(range(len(arms)), 2)
    )
    pairs: list[tuple[int, int]] = []
    for bend, i, j in bends:
        if bend <= STRAIGHT_DEG and not any({i, j} & set(pair) for pair in pairs):
            pairs.append((i, j))
    return sorted(pairs)
