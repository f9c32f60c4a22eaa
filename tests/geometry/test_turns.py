"""Classes of turns and angles in degrees."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsbench.geometry.elementary import LEFT, RIGHT, STRAIGHT, U_TURN, turn_class, wrap_deg


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (0, STRAIGHT), (35, STRAIGHT), (-35, STRAIGHT), (35.1, LEFT), (-35.1, RIGHT), (144.9, LEFT),
        (-144.9, RIGHT), (145, U_TURN), (-145, U_TURN), (180, U_TURN), (-180, U_TURN), (350, STRAIGHT), (270, RIGHT),
    ],
)  # fmt: skip
def test_turn_classes_at_their_bounds(change: float, expected: str) -> None:
    assert turn_class(change) == expected


def test_a_rule_has_its_own_bounds() -> None:
    assert [turn_class(change, 20.0, 100.0) for change in (20, 21, -99, 100)] == [STRAIGHT, LEFT, RIGHT, U_TURN]


@given(st.floats(-180, 180))
def test_a_mirrored_turn_has_the_mirrored_class(change: float) -> None:
    mirrored = {LEFT: RIGHT, RIGHT: LEFT, STRAIGHT: STRAIGHT, U_TURN: U_TURN}
    assert turn_class(-change) == mirrored[turn_class(change)]


@given(st.floats(-1e4, 1e4))
def test_wrapped_degrees_are_the_same_angle_in_their_range(angle: float) -> None:
    wrapped = wrap_deg(angle)
    assert -180.0 < wrapped <= 180.0
    assert (wrapped - angle) / 360.0 == pytest.approx(round((wrapped - angle) / 360.0), abs=1e-9)
