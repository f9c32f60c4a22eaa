"""Polylines: invariants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.geometry.elementary import wrap_deg
from tsbench.make.maps.pieces import chord_over_arc, cut, densified, heading_away, heading_towards, length

coordinate = st.floats(-500, 500).map(lambda value: round(value, 2))
lines = st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=8, unique=True).map(
    lambda points: np.array(points, float)
)


@given(lines, st.floats(0, 1), st.floats(0, 1))
def test_parts_of_a_line_add_up(line: np.ndarray, one: float, other: float) -> None:
    total = length(line)
    start, end = sorted((one * total, other * total))
    part = cut(line, start, end)
    # vertices within 5 cm of a cut are merged into it
    assert length(part) == pytest.approx(end - start, abs=0.11)
    assert np.allclose(part[0], cut(line, 0, start)[-1], atol=1e-6)


@given(lines)
def test_a_chord_is_never_longer_than_its_arc(line: np.ndarray) -> None:
    assert 0 <= chord_over_arc(line) <= 1 + 1e-9
    assert chord_over_arc(line) == pytest.approx(chord_over_arc(line[::-1]))


@given(lines)
def test_driving_back_turns_the_heading_round(line: np.ndarray) -> None:
    there, back = heading_away(line), heading_towards(line[::-1])
    assert abs(wrap_deg(there - back - 180)) < 1e-6 or abs(wrap_deg(there - back + 180)) < 1e-6


def test_densified_keeps_ends_and_step() -> None:
    points = densified(np.array([[0.0, 0.0], [95.0, 0.0]]), 10.0)
    assert points[0].tolist() == [0, 0]
    assert points[-1].tolist() == [95, 0]
    assert np.diff(points[:, 0]).max() <= 10
