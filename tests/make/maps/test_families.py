"""The four families on a town whose maps can be counted by hand."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from town import make_town

from tsbench.make.maps.crop import REGISTRY, plain_crop
from tsbench.make.maps.junctions_and_corridors import Arm, junction_shape, least_separation, through_pairs
from tsbench.make.maps.pieces import chord_over_arc
from tsbench.make.maps.roundabouts import ARM_CUTS_M, shape_fault
from tsbench.make.maps.source import SourceNetwork
from tsbench.scenarios.map_pool import PoolRow


def found(source: SourceNetwork, family: str) -> tuple[list[PoolRow], Counter[str]]:
    rejected: Counter[str] = Counter()
    return list(REGISTRY[family].find(source, rejected)), rejected


def arms(*headings: float) -> list[Arm]:
    return [Arm(2 * i, 2 * i + 1, heading, 80.0) for i, heading in enumerate(headings)]


@pytest.mark.parametrize(
    ("headings", "shape"),
    [
        ((0, 90, 180), "T"),
        ((0, 60, 180), "T"),
        ((0, 90, 180, 270), "X"),
        ((10, 95, 200, 265), "X"),
        ((0, 15, 180), ""),  # a fork
        ((0, 39, 180), ""),  # arms closer than 40 degrees
        ((0, 120, 240), ""),  # a star: nothing goes straight on
        ((0, 50, 180, 230), "X"),
        ((0, 45, 90, 180), ""),  # a T with one arm more
        ((0, 180), ""),
    ],
)
def test_what_is_a_t_and_what_an_x(headings: tuple[float, ...], shape: str) -> None:
    assert junction_shape(arms(*headings)) == shape


@pytest.mark.parametrize("turn", [17.0, 90.0, 200.0, 359.0])
def test_shape_does_not_depend_on_the_compass(turn: float) -> None:
    turned = arms(*(heading + turn for heading in (0, 70, 185)))
    assert junction_shape(turned) == "T"
    assert through_pairs(turned) == [(0, 2)]
    assert least_separation(turned) == pytest.approx(70)


def test_junctions_of_the_town(tiny: SourceNetwork) -> None:
    rows, rejected = found(tiny, "junction")
    shapes = Counter(row.shape for row in rows)
    # 3 x 2 crossings inside, one of them with a signal; 3 + 3 + 2 + 2 T on the border
    assert shapes == {"X": 5, "T": 10}
    assert rejected["junction: has signals"] == 1
    assert rejected["junction: neither T nor X (merge, fork, split carriageway, star)"] == 1
    signalled = str(make_town().node(150, 130))
    assert all(signalled not in row.junction_ids for row in rows)
    for row in rows:
        assert len(row.fields["arms"]) == {"T": 3, "X": 4}[row.shape]
        assert all(40 <= arm["length_m"] <= 80 for arm in row.fields["arms"])


def test_roundabout_has_a_map_for_each_entry_exit_and_cut(tiny: SourceNetwork) -> None:
    rows, _ = found(tiny, "roundabout")
    assert len({row.map_id for row in rows}) == 4 * 3  # never out again on the arm of the entry
    cuts = [(row.fields["entry_cut_m"], row.fields["arm_cut_m"]) for row in rows]
    assert cuts[0] == (80.0, 80.0)
    assert set(cuts) == set(ARM_CUTS_M)
    for row in rows:
        detail = row.fields
        ring = detail["ring"]
        heads = [tiny.head[tiny.edge_row[edge]] for edge in ring]
        tails = [tiny.tail[tiny.edge_row[edge]] for edge in ring]
        assert heads == [*tails[1:], tails[0]]
        assert row.length_m == pytest.approx(125, abs=3)
        assert len(detail["entries"]) == len(detail["exits"]) == 4
        entry, leave = tiny.edge_row[detail["entry_edge"]], tiny.edge_row[detail["exit_edge"]]
        assert tiny.head[entry] in tails
        assert tiny.tail[leave] in tails
        assert tiny.opposite[entry] != leave
        assert detail["rank"] in (0, 1, 2)
    by_entry = Counter((row.fields["entry"], row.fields["rank"]) for row in rows)
    assert set(by_entry.values()) == {len(ARM_CUTS_M)}


def polygon(*angles_deg: float, radius: float = 30.0) -> np.ndarray:
    """A closed line with its corners on a circle, (k, 2)."""
    angles = np.radians(angles_deg)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


BLOCK = "a block of one-way streets, not round"
CIRCLE = polygon(*range(0, 360, 15))


@pytest.mark.parametrize(
    ("line", "fine", "coarse"),
    [
        (CIRCLE, "", ""),
        (polygon(0, 90, 180, 270), BLOCK, BLOCK),
        (polygon(0, 80, 150, 220, 290), BLOCK, ""),
        (polygon(0, 100, 180, 230, 290), BLOCK, BLOCK),
        (CIRCLE[::-1], "driven clockwise", "driven clockwise"),
        (CIRCLE / 8, "circumference outside 30-700 m", "circumference outside 30-700 m"),
    ],
)
def test_a_generalised_ring_may_have_blunt_corners_but_be_no_block(line: np.ndarray, fine: str, coarse: str) -> None:
    assert shape_fault(line, coarse=False) == fine
    assert shape_fault(line, coarse=True) == coarse


def test_corridors_are_one_to_a_way_and_as_straight_as_they_say(tiny: SourceNetwork) -> None:
    rows, rejected = found(tiny, "corridor")
    ways = [way for row in rows for way in row.osm_ids]
    assert len(ways) == len(set(ways))
    assert rejected["corridor: its OSM way has one already"] > 0
    for row in rows:
        plain = plain_crop(row, tiny)
        line = next(edge.shape for edge in plain.edges if edge.id == row.fields["edge"])
        ratio = chord_over_arc(np.array(line))
        assert 150 <= row.length_m <= 250
        assert ratio == pytest.approx(row.curvature, abs=0.001)
        assert row.shape == ("straight" if row.curvature >= 0.99 else "curved")
    assert any(row.shape == "curved" for row in rows)
    assert any(row.lane_bucket == 3 and row.oneway for row in rows)
    assert any(row.lanes == 2 and not row.oneway for row in rows)


def test_dual_paths_part_at_the_junction_and_meet_at_the_destination(tiny: SourceNetwork) -> None:
    rows, _ = found(tiny, "dual_path")
    assert len({row.map_id for row in rows}) == len(rows) > 20
    for row in rows:
        detail = row.fields
        short, compliant = detail["short"], detail["compliant"]
        assert short[-1] == compliant[-1] == detail["destination_edge"]
        assert not set(short[:-1]) & set(compliant[:-1])
        assert detail["compliant_m"] - detail["short_m"] >= 20
        assert detail["short_m"] <= 350
        assert detail["compliant_m"] <= 700
        for way in (short, compliant):
            edges = [tiny.edge_row[edge] for edge in (detail["signed_edge"], *way)]
            for one, other in pairwise(edges):
                assert tiny.head[one] == tiny.tail[other]
        junction = tiny.node_ids.index(detail["junction"])
        assert all(tiny.tail[tiny.edge_row[edge]] != junction for edge in (*short[1:], *compliant[1:]))
