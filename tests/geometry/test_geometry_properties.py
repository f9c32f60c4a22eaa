from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tsbench.geometry.elementary import wrap
from tsbench.geometry.footprint import boxes_overlap, corners, front
from tsbench.geometry.overlap import conflict_zone, conflict_zones
from tsbench.geometry.polyline import Polyline, join

ANGLE = st.floats(-math.pi, math.pi)
COORDINATE = st.floats(-50.0, 50.0)
BOX = st.tuples(COORDINATE, COORDINATE, ANGLE, st.floats(0.5, 15.0), st.floats(0.3, 3.0))


@st.composite
def gentle_lines(draw: st.DrawFn) -> Polyline:
    """Lines that never turn back on themselves: at most 100 degrees in all, in steps of 1 to 12 m."""
    n = draw(st.integers(2, 9))
    steps = draw(st.lists(st.floats(1.0, 12.0), min_size=n, max_size=n))
    turns = draw(st.lists(st.floats(-0.2, 0.2), min_size=n, max_size=n))
    heading = draw(ANGLE) + np.cumsum(turns)
    delta = np.column_stack((np.cos(heading), np.sin(heading))) * np.array(steps)[:, None]
    return Polyline(np.vstack(([draw(COORDINATE), draw(COORDINATE)], delta)).cumsum(axis=0))


@given(st.floats(-1e4, 1e4))
def test_wrap_keeps_the_angle_and_the_range(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


@given(gentle_lines(), st.floats(-0.3, 1.3), st.floats(-0.45, 0.45))
def test_project_inverts_point_at_near_the_line(line: Polyline, share: float, d: float) -> None:
    s = share * line.length
    inner = [v for v in line.s.tolist() if 0.0 < v < line.length]
    # Beside a vertex, on the inner side, two feet of the perpendicular compete.
    assume(all(abs(v - s) > 0.3 for v in inner))
    x, y = line.point_at(s, d)
    found = line.project(x, y)
    assert found == pytest.approx((s, d), abs=1e-6)
    s_many, d_many = line.project_many(np.array([[x, y]]))
    assert (float(s_many[0]), float(d_many[0])) == pytest.approx(found, abs=1e-9)


@given(gentle_lines(), COORDINATE, COORDINATE)
def test_project_agrees_with_its_vectorised_twin(line: Polyline, x: float, y: float) -> None:
    s, d = line.project(x, y)
    s_many, d_many = line.project_many(np.array([[x, y]]))
    # Equally near feet may differ in s, never in distance.
    assert abs(float(d_many[0])) == pytest.approx(abs(d), abs=1e-6) or float(s_many[0]) == pytest.approx(s)


@given(gentle_lines(), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_slices_have_the_length_asked_for_and_join_again(line: Polyline, a: float, b: float) -> None:
    lo, hi = sorted((a * line.length, b * line.length))
    assume(hi - lo > 0.01 and lo > 0.01 and line.length - hi > 0.01)
    parts = [line.slice(0.0, lo), line.slice(lo, hi), line.slice(hi, line.length)]
    assert parts[1].length == pytest.approx(hi - lo, abs=1e-6)
    whole = join(parts)
    assert whole.length == pytest.approx(line.length, abs=1e-6)
    middle = 0.5 * line.length
    assert whole.point_at(middle) == pytest.approx(line.point_at(middle), abs=1e-6)


@given(gentle_lines(), st.floats(0.3, 5.0))
def test_resampled_lines_stay_on_the_line(line: Polyline, step: float) -> None:
    fine = line.resampled(step)
    assert max(np.diff(fine.s)) <= step + 1e-6
    assert np.abs(line.project_many(fine.points)[1]).max() < 1e-6


def _moved(box: tuple[float, ...], angle: float, dx: float, dy: float) -> tuple[float, ...]:
    x, y, heading, length, width = box
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y + dx, s * x + c * y + dy, heading + angle, length, width


@given(BOX, BOX, ANGLE, COORDINATE, COORDINATE)
def test_boxes_overlap_is_symmetric_and_the_same_everywhere(
    a: tuple[float, ...], b: tuple[float, ...], angle: float, dx: float, dy: float
) -> None:
    near = (a[0] + b[0] / 10, a[1] + b[1] / 10, *b[2:])
    hit = boxes_overlap(*a, *near)
    assert boxes_overlap(*near, *a) == hit
    # A touch to the last digit may fall either way: grow and shrink by a nanometre before the move.
    grown = (*near[:3], near[3] + 1e-6, near[4] + 1e-6)
    shrunk = (*near[:3], near[3] - 1e-6, near[4] - 1e-6)
    if hit:
        assert boxes_overlap(*_moved(a, angle, dx, dy), *_moved(grown, angle, dx, dy))
    else:
        assert not boxes_overlap(*_moved(a, angle, dx, dy), *_moved(shrunk, angle, dx, dy))


@given(BOX, BOX)
def test_boxes_that_hold_each_others_corners_overlap(a: tuple[float, ...], b: tuple[float, ...]) -> None:
    for x, y in corners(*b):
        c, s = math.cos(a[2]), math.sin(a[2])
        u, v = c * (x - a[0]) + s * (y - a[1]), c * (y - a[1]) - s * (x - a[0])
        if abs(u) < a[3] / 2 - 1e-9 and abs(v) < a[4] / 2 - 1e-9:
            assert boxes_overlap(*a, *b)


@given(BOX)
def test_front_lies_between_the_front_corners(box: tuple[float, ...]) -> None:
    x, y, heading, length, width = box
    left, _, _, right = corners(x, y, heading, length, width)
    middle = ((left[0] + right[0]) / 2, (left[1] + right[1]) / 2)
    assert front(x, y, heading, length) == pytest.approx(middle, abs=1e-9)


@given(st.floats(0.6, 2.5), st.floats(-3.0, 3.0), ANGLE, st.floats(2.6, 3.8), st.floats(2.6, 3.8), st.booleans())
def test_conflict_zones_are_symmetric_and_turn_with_the_paths(
    crossing: float, shift: float, angle: float, a_width: float, b_width: float, opened: bool
) -> None:
    def lines(turn: float) -> tuple[Polyline, Polyline]:
        c, s = math.cos(turn), math.sin(turn)
        a = np.array([[-15.0, 0.0], [0.0, shift / 4], [15.0, shift]])
        b = np.array([[-15.0 * math.cos(crossing), -15.0 * math.sin(crossing)], [0.0, 0.5]])
        b = np.vstack((b, -b[:1]))
        turned = np.array([[c, s], [-s, c]])
        return Polyline(a @ turned + 7.0), Polyline(b @ turned + 7.0)

    depth = 0.5 if opened else 0.0
    (a, b), (a2, b2) = lines(0.0), lines(angle)
    here = conflict_zone(a, a_width, b, b_width, min_depth=depth)
    swapped = conflict_zone(b, b_width, a, a_width, min_depth=depth)
    there = conflict_zone(a2, a_width, b2, b_width, min_depth=depth)
    assert swapped is not None
    assert there is not None
    of = (here.a_in, here.a_out, here.b_in, here.b_out)
    assert (swapped.b_in, swapped.b_out, swapped.a_in, swapped.a_out) == pytest.approx(of, abs=1e-6)
    # Opening rounds corners by polygons that stand along the axes: turned, they differ by parts of a millimetre.
    exact = 1e-3 if opened else 1e-6
    assert (there.a_in, there.a_out, there.b_in, there.b_out) == pytest.approx(of, abs=exact)
    assert 0.0 <= here.a_in < here.a_out <= a.length
    assert 0.0 <= here.b_in < here.b_out <= b.length


def test_parallel_lanes_have_no_zone_and_slivers_can_be_left_out() -> None:
    a = Polyline([[0, 0], [20, 0]])
    assert conflict_zone(a, 3.2, Polyline([[0, 3.2], [20, 3.2]]), 3.2) is None
    beside = Polyline([[0, 3.1], [20, 3.1]])
    assert conflict_zone(a, 3.2, beside, 3.2) is not None
    assert conflict_zone(a, 3.2, beside, 3.2, min_depth=0.5) is None
    assert conflict_zones([(a, 3.2)], []) == ((),)


@pytest.mark.parametrize("points", [[[0, 0]], [[0, 0], [0, 0]], [[0, 0], [float("nan"), 1]], [0, 1, 2]])
def test_what_is_no_line_is_refused(points: list[object]) -> None:
    with pytest.raises(ValueError, match="polyline"):
        Polyline(points)  # type: ignore[arg-type]
