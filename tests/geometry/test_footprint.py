from __future__ import annotations

import math

import pytest

from tsbench.geometry.footprint import share_in_band

WIDE = (0.0, 50.0, -20.0, 1.5)
NARROW = (0.0, 50.0, -0.5, 0.5)


@pytest.mark.parametrize(
    ("y", "heading", "share"),
    [
        (0.0, 0.0, 1.0),
        (1.5, 0.0, 0.5),
        (2.5, 0.0, 0.0),
        (2.1, math.pi, 0.2),
        (2.0, math.pi / 2, 0.375),
        (1.5, 0.3, 0.5),
    ],
)
def test_share_of_a_rectangle_beside_a_line(y: float, heading: float, share: float) -> None:
    assert share_in_band(20.0, y, heading, 4.0, 2.0, WIDE) == pytest.approx(share, abs=1e-9)


@pytest.mark.parametrize(("x", "share"), [(0.0, 0.25), (20.0, 0.5), (51.0, 0.125), (53.0, 0.0)])
def test_share_of_a_rectangle_in_a_narrow_band_and_across_its_ends(x: float, share: float) -> None:
    assert share_in_band(x, 0.0, 0.0, 4.0, 2.0, NARROW) == pytest.approx(share)


def test_corners_of_a_narrow_band_are_cut_off_a_turned_rectangle() -> None:
    # Turned by 45 degrees, a square's corner of height h has the area h * h.
    share = share_in_band(20.0, 1.5 + math.sqrt(2.0) - 0.3, math.pi / 4, 2.0, 2.0, WIDE)
    assert share == pytest.approx(0.3**2 / 4.0)
